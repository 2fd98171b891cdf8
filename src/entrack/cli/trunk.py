"""`entrack trunk train | import | quantise | info`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import CUTOUTS, STILLS, checking_call, new_app, stages
from entrack.errors import require
from entrack.files import writing

app = new_app(no_args_is_help=True)


@app.command()
def train(
    data: Annotated[
        list[str], typer.Option(metavar="FORMAT:DIR", help="Annotated clips; may be repeated.")
    ],
    stills: Annotated[Path, STILLS],
    teacher: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            exists=True,
            dir_okay=False,
            help="ResNet-18: .pth, .safetensors, or folded .npz.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="RUN", help="Folder of the run.")],
    config: Annotated[
        Path | None, typer.Argument(metavar="CONFIG", help="TOML; by default the shipped trunk's.")
    ] = None,
    unlabelled: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", exists=True, file_okay=False, help="Videos without annotation."
        ),
    ] = None,
    cutouts: Annotated[Path | None, CUTOUTS] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where RUN was stopped.")] = False,
) -> None:
    """Train a trunk: distil it, then fine-tune through the filter.

    \b
    entrack trunk train trunk.toml --data folder:clips --stills pictures \\
            --teacher resnet18_layer3_folded.npz --out runs/trunk

    RUN keeps the state, the losses (CSV and TensorBoard), and in the end trunk.onnx. Ctrl-C stops;
    the same call with --resume goes on.
    """  # noqa: D301
    require("torch", "train")
    from entrack.config import read
    from entrack.model import assets
    from entrack.trunks.material import gather
    from entrack.trunks.train import TrunkTrainConfig, train_trunk

    with checking_call():
        path = config or assets().parent / "presets" / "trunk.toml"
        settings = read(TrunkTrainConfig, path)
        material = gather(settings.material, data, stills, unlabelled, cutouts, _tell)
    try:
        with writing(out), stages() as report:
            trunk = train_trunk(settings, material, teacher, out, resume, report)
    except KeyboardInterrupt:
        _tell(f"stopped: the same call with --resume goes on from the last checkpoint in {out}")
        raise
    typer.echo(trunk)


@app.command("import")
def import_(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="ResNet-18: .pth, .safetensors, or folded .npz.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Becomes a model folder.")],
) -> None:
    """Make the paper's model of ResNet-18's weights.

    \b
    entrack trunk import resnet18-f37072fd.pth --out models/paper
    entrack track video.mp4 --box 10,20,40,80 --model models/paper
    """  # noqa: D301
    require("torch", "train")
    from entrack.trunks.importing import import_trunk

    with writing(out):
        import_trunk(file, out)
    typer.echo(out / "model.toml")


@app.command()
def quantise(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A float trunk.onnx.")],
    pictures: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            exists=True,
            file_okay=False,
            help="Pictures to calibrate on, and to check with.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The int8 trunk.")],
) -> None:
    """Make a trunk int8, unless its features drift too far.

    \b
    entrack trunk quantise runs/trunk/trunk.onnx --pictures pictures --out trunk.onnx
    """  # noqa: D301
    require("onnxruntime", "train")
    from entrack.trunks.crops import load_stills
    from entrack.trunks.quantise import quantise as quantise_

    with writing(out):
        found = quantise_(file, load_stills(pictures), out)
    for engine, a in found.items():
        typer.echo(
            f"{engine}: features agree with float to a cosine of {a.cosine:.4f}, responses to a "
            f"correlation of {a.response:.4f}; peaks move by {a.moved:.3f} cells"
        )


@app.command()
def info(
    model: Annotated[
        str, typer.Argument(metavar="[MODEL|FILE.onnx]", help="Name, model folder, or trunk.")
    ] = "default",
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads of every engine; all cores by default.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Say what a trunk is made of, and what it costs here.

    \b
    entrack trunk info
    entrack trunk info models/paper --threads 2
    entrack trunk info runs/trunk/trunk.onnx --json
    """  # noqa: D301
    from entrack.trunks.info import inspect

    with checking_call():
        found = inspect(model, threads)
    if as_json:
        typer.echo(json.dumps(asdict(found), indent=1))
        return
    convolutions = ", ".join(f"{count} in {kind}" for kind, count in found.convolutions.items())
    lines = {
        "trunk": found.path,
        "sha256": found.sha256,
        "model": found.model,
        "provenance": found.provenance,
        "card": found.card,
        "size": f"{found.bytes / 1e6:.2f} MB, {found.parameters / 1e6:.2f} million parameters",
        "work": f"{found.gmac:.2f} GMAC for a patch of {found.size}×{found.size}",
        "precision": f"convolutions: {convolutions}",
    } | {
        engine: f"{ms['alone']:.2f} ms a patch, {ms['four']:.2f} ms as one of four; "
        f"{found.threads} thread{'s' * (found.threads > 1)}"
        for engine, ms in found.ms.items()
    }
    for name, value in lines.items():
        if value is not None:
            typer.echo(f"{name:12} {value}")


def _tell(what: str) -> None:
    typer.echo(what, err=True)
