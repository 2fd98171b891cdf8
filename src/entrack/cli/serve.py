"""`entrack serve`."""

from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import checking_call, new_app
from entrack.errors import require

app = new_app()


@app.command()
def serve(
    port: Annotated[int, typer.Option(help="0 takes a free one.")] = 8000,
    host: Annotated[
        str, typer.Option(help="0.0.0.0 lets other machines in; by default none is.")
    ] = "127.0.0.1",
    model: Annotated[str, typer.Option(help="Name of a model, or its folder.")] = "default",
    threads: Annotated[
        int | None, typer.Option(help="Threads of the network; all cores by default.")
    ] = None,
    megabytes: Annotated[int, typer.Option(min=1, help="The largest upload, in MB.")] = 1000,
    show: Annotated[bool, typer.Option(help="Open the page in this machine's browser.")] = True,
) -> None:
    """Serve a web page: draw a box on a video, and watch it tracked.

    \b
    entrack serve
    entrack serve --port 8080 --no-show
    entrack serve --host 0.0.0.0          # anybody who reaches this machine may track videos on it

    Videos stay on this machine and are deleted when their page is closed. Ctrl-C ends it.
    """  # noqa: D301
    require("nicegui", "web")
    from entrack.model import load_model
    from entrack.web.page import Page, Settings
    from entrack.web.server import scratch, serve

    with checking_call():
        load_model(model)
    with scratch() as folder:
        settings = Settings(Path(folder), model, threads, megabytes)
        serve(lambda: Page(settings), host, port, show, megabytes, _tell)


def _tell(address: str) -> None:
    typer.echo(f"open {address} in a browser; Ctrl-C ends it", err=True)
