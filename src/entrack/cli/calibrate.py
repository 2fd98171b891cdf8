"""`entrack calibrate`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import checking_call, new_app
from entrack.cli.many import ManyValues
from entrack.model import load_model

app = new_app()


@app.command(cls=ManyValues)
def calibrate(
    model: Annotated[str, typer.Argument(metavar="MODEL", help="A shipped model, or a folder.")],
    data: Annotated[
        list[str],
        typer.Option(metavar="FORMAT:DIR...", help="Annotated videos, as of entrack evaluate."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the new model; by default MODEL-calibrated."),
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME...", help="Sequences to use; by default all.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=2, help="Frames of each sequence; by default all.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
) -> None:
    """Fit a model's score to your own footage, and write the model with it.

    \b
    entrack calibrate default --data folder:my_videos --out my_model
    entrack calibrate cf --data folder:clips synthetic:hard,seed=5000,count=24 --frames 200
    entrack track video.mp4 --box 10,20,30,40 --model my_model

    The score becomes the chance that the box overlaps the target by more than half, as it was found
    on the footage; where the tracker never loses its target there is nothing to learn.
    """  # noqa: D301
    from entrack import calibrate as library

    def tell(number: int, of: int, name: str) -> None:
        typer.echo(f"{number}/{of} {name}", err=True)

    with checking_call():
        folder = out or Path(f"{load_model(model).name}-calibrated")
        found = library.calibrate(model, data, folder, only or (), frames, tell)
    if as_json:
        typer.echo(json.dumps({"model": str(folder), **asdict(found)}, indent=1))
        return
    typer.echo(f"{folder / 'model.toml'}\n[config.score]")
    typer.echo("".join(f"{name} = {value}\n" for name, value in found.weights.items()), nl=False)
    typer.echo("[config.spread]")
    typer.echo("".join(f"{name} = {value}\n" for name, value in found.spread.items()), nl=False)
    typer.echo(
        f"# {found.frames} frames of {found.sequences} sequences, IoU > .5 in {found.share:.1%}"
    )
    for words, quality in (("before", found.before), ("after, left-out sequences", found.after)):
        if quality is not None:
            area = "–" if quality.roc_auc is None else f"{quality.roc_auc:.3f}"
            typer.echo(f"# {words}: expected calibration error {quality.ece:.3f}, ROC AUC {area}")
