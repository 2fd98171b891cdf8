"""`entrack data list | check | synth`."""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import checking_call, new_app, progress
from entrack.cli.many import ManyValues
from entrack.datasets import FORMATS, Sequence, lists, open_dataset
from entrack.errors import EntrackError

app = new_app(no_args_is_help=True)


@app.command("list")
def list_formats() -> None:
    """Print the formats that can be read, with their official lists."""
    counts = {
        "otb": f"{len(lists.otb())} targets",
        "uav123": f"{len(lists.uav123())} targets",
        "lasot": f"{len(lists.lasot_test())} test and {len(lists.lasot_train())} training videos",
        **{year: f"{len(lists.vot(year))} sequences" for year in lists.VOT_YEARS},
    }
    for name, function in FORMATS.items():
        module, _, _ = function.partition(":")
        typer.echo(f"{name:10} {counts.get(name, 'any number of sequences')}; see {module}")


@app.command()
def check(
    data: Annotated[str, typer.Argument(metavar="FORMAT:DIR", help="The dataset.")],
    every_frame: Annotated[
        bool, typer.Option("--every-frame", help="Decode every picture, which takes a while.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Say what is wrong with a dataset's folder, file by file, and what will be scored.

    \\b
    entrack data check otb:/data/OTB100
    entrack data check lasot:/data/LaSOT --every-frame

    Exit code 1 if a sequence is missing or cannot be used; `evaluate` scores the others.
    """  # noqa: D301
    from entrack.datasets.check import check as findings_of

    with checking_call():
        dataset = open_dataset(data)
    findings = list(findings_of(dataset, every_frame=every_frame))
    wrong = {f.sequence for f in findings if f.kind != "note"}
    scored = len(set(dataset.names) - {f.sequence for f in findings if not f.scored})
    total = len(dataset.official) or len(dataset.names)
    if as_json:
        summary = {"scored": scored, "of": total, "findings": [asdict(f) for f in findings]}
        typer.echo(json.dumps(summary, indent=1))
    else:
        for finding in findings:
            typer.echo(finding)
        typer.echo(f"{scored} of {total} sequences of {dataset.format} will be scored")
    if wrong:
        raise EntrackError(f"{len(wrong)} sequences of {dataset.root} cannot be used as they are")


@app.command(cls=ManyValues)
def synth(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the sequences.")],
    count: Annotated[int, typer.Option(min=1, help="Sequences.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of the first one; the next has the next.")] = 0,
    length: Annotated[int, typer.Option(min=1, help="Frames of each.")] = 100,
    show: Annotated[
        list[str] | None,
        typer.Option(metavar="ATTRIBUTE...", help="What they show; by default a random choice."),
    ] = None,
    hard: Annotated[
        bool, typer.Option("--hard", help="Occlusions, exits and look-alikes of 240 frames.")
    ] = False,
) -> None:
    """Make sequences with exact boxes, in the layout of GOT-10k: open them as synthetic:OUT.

    \b
    entrack data synth made --count 50
    entrack data synth made --show scale lookalikes --length 200
    """  # noqa: D301
    from entrack.datasets import synthetic

    with checking_call():
        if hard:
            sequences = synthetic.hard(count, seed)
        else:
            configs = [synthetic.sample(seed + i, show, length=length) for i in range(count)]
            sequences = map(synthetic.synthesise, configs)
    with progress("making", count) as made:
        names = synthetic.write(_each(sequences, made), out)
    typer.echo(f"{len(names)} sequences in {out}")


def _each(sequences: Iterable[Sequence], made: Callable[[], None]) -> Iterator[Sequence]:
    for sequence in sequences:
        yield sequence
        made()
