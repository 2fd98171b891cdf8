"""`entrack track`."""

import json
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

import entrack
from entrack import box as boxes_
from entrack.batch import read_list
from entrack.box import Boxes
from entrack.cli.batching import run_batch
from entrack.cli.console import CallError, checking_call, new_app
from entrack.cli.tracking import Summary, run
from entrack.errors import require
from entrack.model import load_model
from entrack.run import Recorder
from entrack.tracker import Estimate, Tracker
from entrack.video import Frame, Source, open_source

app = new_app()
Each = Callable[[Frame, list[Estimate]], object]


@app.command()
def track(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="SOURCE", help="Video, folder of pictures, glob, number of a camera, or URL."
        ),
    ] = None,
    box: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,W,H",
            help="The object in the first frame: left, top, width and height in pixels. "
            "Once for each object.",
        ),
    ] = None,
    select: Annotated[
        bool, typer.Option("--select", help="Draw the boxes on a web page instead.")
    ] = False,
    model: Annotated[str, typer.Option(help="Name of a model, or its folder.")] = "default",
    boxes: Annotated[
        Path | None, typer.Option(metavar="OUT.csv|.jsonl|.txt", help="Write the boxes here.")
    ] = None,
    video: Annotated[
        Path | None, typer.Option(metavar="OUT.mp4", help="Write the video with boxes drawn here.")
    ] = None,
    start: Annotated[int, typer.Option(help="First frame; they count from 0.")] = 0,
    stop: Annotated[int | None, typer.Option(help="Frame before which to stop.")] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads of the network; all cores by default.")
    ] = None,
    rerun: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.rrd|spawn", help="Log all that is seen for the Rerun viewer, or open it."
        ),
    ] = None,
    batch: Annotated[
        Path | None,
        typer.Option(
            metavar="LIST.csv",
            help="Track many clips instead: rows source,x,y,w,h and, if you like, name,start,stop.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Of a batch: processes, one by default; on a cluster, all."),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="auto|local|ADDRESS", help="Of a batch: a Ray cluster, or this machine's own."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Track objects through a video.

    \b
    entrack track surfer.mp4 --box 125,180,137,167 --video out.mp4
    entrack track 'frames/*.jpg' --box 20,30,40,80 --boxes out.csv
    entrack track surfer.mp4 --select --boxes out.csv
    entrack track match.mkv --start 250 --box 10,20,40,80 --box 90,25,40,80
    entrack track rtsp://camera/stream --box 20,30,40,80 --boxes out.jsonl
    entrack track --batch clips.csv --boxes 'out/{name}.csv' --workers 8

    The CSV has a row for each frame and object: score is the probability that the box is on the
    object, lost is 1 where the tracker does not see it, sigma is the standard deviation of each
    side. Ctrl-C ends the work and finishes the files.

    Of a batch each clip has files of its own, which appear when it is complete: call it again, and
    it goes on with what is missing. Rows of the same name are objects of one clip.
    """  # noqa: D301
    if batch:
        if source or box or start or stop is not None:
            raise CallError("--batch takes SOURCE, --box, --start and --stop from its list")
        with checking_call():
            clips = read_list(batch, boxes, video, model, threads or 1)
            load_model(model)
        return run_batch(clips, workers, cluster, as_json)
    if source is None:
        raise CallError("expected a SOURCE, or a --batch. Try 'entrack track --help'.")
    if workers or cluster:
        raise CallError("--workers and --cluster are for a --batch: one video is one worker's work")
    with checking_call():
        if bool(box) == select:
            raise CallError("say where the object is: either --box X,Y,W,H or --select")
        wanted = [boxes_.parse(text) for text in box or []]
        opened = open_source(source, start, stop)
    with opened:
        if select:
            wanted = _drawn(opened)
        given = [_inside(number, b, opened.size) for number, b in enumerate(wanted, 1)]
        _spare(source, boxes, video)
        with checking_call():
            tracker = entrack.load(model, threads=threads)
            recorder = Recorder(boxes, video, len(given), opened.fps)
        summary = Summary(opened.name, recorder.paths)
        try:
            with _logging(rerun, tracker, summary.files) as each:
                run(tracker, opened, given, recorder, summary, each)
        finally:
            if summary.frames:
                typer.echo(json.dumps(summary.as_dict()) if as_json else summary)


@contextmanager
def _logging(
    target: str | None, tracker: Tracker, files: list[Path]
) -> Generator[Each, None, None]:
    """What to do with every frame: log it for Rerun, or nothing."""
    if target is None:
        yield lambda frame, estimates: None
        return
    require("rerun", "rerun")
    from entrack.rerun_log import RerunLog

    with RerunLog(target) as log:
        files.extend([log.path] if log.path else [])
        yield lambda frame, estimates: log.write(frame, estimates, tracker.looks)


def _drawn(source: Source) -> list[Boxes]:
    """Have the boxes drawn on the first frame, on a page in a browser."""
    require("nicegui", "web")
    from entrack.web.select import select

    def tell(address: str) -> None:
        port = address.rpartition(":")[2]
        typer.echo(f"draw the box at {address}", err=True)
        typer.echo(f"(from another machine: ssh -L {port}:127.0.0.1:{port} HOST)", err=True)

    return select(source.first.image, source.name, tell)


def _inside(number: int, box: Boxes, size: tuple[int, int]) -> Boxes:
    """The part of a box inside the picture; says so if that is not all of it."""
    clipped, (width, height) = boxes_.clip(box, *size), size
    if clipped[2:].min() < 1:
        raise CallError(f"box {_text(box)} lies outside the {width}×{height} picture")
    if (clipped != box).any():
        note = f"box {number} reaches outside the {width}×{height} picture"
        typer.echo(f"note: {note}: tracking {_text(clipped)}", err=True)
    return clipped


def _text(box: Boxes) -> str:
    return ",".join(f"{side:g}" for side in box)


def _spare(source: str, *outputs: Path | None) -> None:
    """Refuse to write over what is being read, or over a folder."""
    for path in outputs:
        if path and path.is_dir():
            raise CallError(f"{path} is a folder: name a file in it")
        if path and path.exists() and Path(source).exists() and path.samefile(source):
            raise CallError(f"{path} is the source: choose another name for what is written")
