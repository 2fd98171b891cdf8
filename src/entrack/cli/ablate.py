"""`entrack ablate`."""

from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import CUTOUTS, STILLS, checking_call, new_app, stages
from entrack.cli.many import ManyValues
from entrack.errors import require
from entrack.files import writing

app = new_app()


@app.command(cls=ManyValues)
def ablate(
    name: Annotated[
        str,
        typer.Argument(
            metavar="GRID",
            help="What is varied: alpha, critic, inputs, warmstart, template, termination; or "
            "changes, each made alone.",
        ),
    ],
    data: Annotated[
        list[str], typer.Option(metavar="FORMAT:DIR...", help="Annotated clips to learn from.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of runs, table and plot.")],
    test: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FORMAT:DIR...",
            help="Benchmarks to score on; by default the configuration's validation clips.",
        ),
    ] = None,
    config: Annotated[
        str, typer.Option(metavar="paper|default|FILE.toml", help="What the cells are changes of.")
    ] = "default",
    scale: Annotated[
        float,
        typer.Option(min=0.0001, max=1, help="Share of the rounds, looks and steps of a cell."),
    ] = 1.0,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each cell.")] = 3,
    one_start: Annotated[
        bool,
        typer.Option("--one-start", help="All seeds go on from one warm start: cheaper."),
    ] = False,
    cell: Annotated[
        list[str] | None, typer.Option(metavar="CELL...", help="Only these cells.")
    ] = None,
    model: Annotated[str, typer.Option(metavar="MODEL", help="Whose trunk the cells get.")] = "cf",
    stills: Annotated[Path | None, STILLS] = None,
    cutouts: Annotated[Path | None, CUTOUTS] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes that play and track.")] = 2,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where DIR was stopped.")] = False,
) -> None:
    """Train and score every cell of a grid with several seeds, as the paper's ablations (§4.4).

    \b
    entrack ablate alpha --data folder:clips --test otb:OTB100 --out ablations/alpha
    entrack ablate critic --config paper --scale 0.05 --data folder:clips --out ablations/critic
    entrack ablate alpha --cell 0 0.2 --seeds 5 --data folder:clips --out ablations/alpha --resume

    Each cell is a run of `entrack train`, in DIR/cells. Table (Markdown, CSV, LaTeX) and plot are
    renewed after every cell. Ctrl-C stops; the same call with --resume goes on, and may ask for
    more seeds and other cells.
    """  # noqa: D301
    require("torch", "train")
    require("matplotlib", "report")
    from entrack.learn.ablate import Plan, write_tables
    from entrack.learn.ablate import ablate as run
    from entrack.learn.grids import scaled
    from entrack.learn.train import Source, preset, shortened
    from entrack.model import load_model

    with checking_call():
        base = scaled(preset(config), scale)
        source = Source(tuple(data), stills, cutouts)
        wanted = tuple(cell or ())
        plan = Plan(
            name, base, load_model(model), source, tuple(test or ()), seeds, one_start, wanted
        )
        plan.runs()
    try:
        with writing(out), stages() as report:
            left_out = run(plan, out, workers, resume, report, lambda: write_tables(name, out))
    except KeyboardInterrupt:
        typer.echo(f"stopped: the same call with --resume goes on in {out}", err=True)
        raise
    if left_out:
        typer.echo(f"left out: {shortened(left_out)}", err=True)
    for text in write_tables(name, out):
        typer.echo(text)
