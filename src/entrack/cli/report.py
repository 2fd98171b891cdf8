"""`entrack report`."""

from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import checking_call, new_app
from entrack.cli.many import ManyValues

app = new_app()


@app.command(cls=ManyValues)
def report(
    runs: Annotated[
        list[Path], typer.Argument(metavar="DIR", help="Folders that entrack evaluate wrote.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the report; by default report in the first."),
    ] = None,
    baseline: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Compare with this tracker instead of the best one."),
    ] = None,
    sequences: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME...",
            help="Sequences of the filmstrips; by default the worst, and the most divided.",
        ),
    ] = None,
) -> None:
    """Make a page of what was evaluated, with plots and tables as papers print them.

    \b
    entrack report run
    entrack report run others --out report --baseline opencv:csrt
    entrack report run --sequences Bolt2 Skiing

    The page is one file that needs no network; its plots (SVG, PNG) and tables (CSV, Markdown,
    LaTeX) are also written as files beside it.
    """  # noqa: D301
    from entrack.report import write_report

    with checking_call():
        page = write_report(runs, out or runs[0] / "report", baseline, sequences or ())
    typer.echo(page)
