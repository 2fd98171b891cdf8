"""`entrack explain`."""

from pathlib import Path
from typing import Annotated

import typer

import entrack
from entrack import box as boxes_
from entrack.cli.console import checking_call, new_app, progress
from entrack.errors import EntrackError, require
from entrack.video import open_source

app = new_app()


@app.command()
def explain(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="Video, folder of pictures, glob, number of a camera, URL, or a result of a run.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE.png|.pdf|.svg|.mp4", help="A figure of one frame, or a film of all."
        ),
    ],
    box: Annotated[
        str | None,
        typer.Option(metavar="X,Y,W,H", help="The object in the first frame; a result knows it."),
    ] = None,
    frame: Annotated[
        int | None, typer.Option(help="Frame of the figure; ten after the first by default.")
    ] = None,
    model: Annotated[str, typer.Option(help="Name of a model, or its folder.")] = "default",
    start: Annotated[int, typer.Option(help="First frame; they count from 0.")] = 0,
    stop: Annotated[int | None, typer.Option(help="Frame before which to stop.")] = None,
) -> None:
    """Show the way of a frame: search window, features, response, box, side by side.

    \b
    entrack explain surfer.mp4 --box 125,180,137,167 --out way.png --frame 40
    entrack explain surfer.mp4 --box 125,180,137,167 --out way.mp4
    entrack explain run/otb/default/Basketball.txt --out way.png --frame 300   # of entrack evaluate

    Features are shown by their three principal components as red, green and blue: cells of one
    colour look alike to the tracker. Dotted lines around the box are one standard deviation off.
    """  # noqa: D301
    require("matplotlib", "report")
    from entrack.explain import FILM, explain, of_run

    with checking_call():
        if box is None:
            if not source.endswith(".txt"):
                raise EntrackError("a video needs --box X,Y,W,H; a result RUN/…/NAME.txt does not")
            opened, given, model = of_run(Path(source))
        else:
            given = boxes_.parse(box)
            opened = open_source(source, start, stop)
    with opened:
        wanted = start + 10 if frame is None else frame
        total = opened.length if out.suffix.lower() == FILM else wanted - start
        with progress(opened.name, total) as advance:
            for _ in explain(entrack.load(model), opened, given, out, wanted):
                advance()
    typer.echo(out)
