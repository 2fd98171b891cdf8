"""`entrack vot init`."""

from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import checking_call, new_app
from entrack.interop.vot_workspace import write_workspace

app = new_app(no_args_is_help=True)


@app.callback()
def vot() -> None:
    """Work with the official vot-toolkit."""


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The workspace.")],
    model: Annotated[str, typer.Option(help="Name of a model, or its folder.")] = "default",
    name: Annotated[str, typer.Option(help="Name of the tracker there.")] = "entrack",
    stack: Annotated[
        str | None,
        typer.Option(help="Write config.yaml too: vot2018/shortterm, vot2022/shorttermbox, …"),
    ] = None,
) -> None:
    """Add a model to the trackers of a vot-toolkit workspace.

    \b
    entrack vot init WORKSPACE && cd WORKSPACE
    vot initialize vot2022/shorttermbox          # downloads the sequences
    vot test entrack
    vot evaluate entrack && vot analysis entrack

    entrack has to be installed beside vot-toolkit (0.9, with attributee==0.1.9). NAME-trax is the
    same tracker as a server of its own environment. Supervised stacks, until 2019, fail in release
    0.9 for every tracker: python -m entrack.interop.vot_supervised takes the arguments of vot.
    """  # noqa: D301
    with checking_call():
        paths = write_workspace(folder, model, name, stack)
    for path in paths:
        typer.echo(f"wrote {path}")
