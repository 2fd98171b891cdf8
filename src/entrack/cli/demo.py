"""`entrack demo`."""

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

import entrack
from entrack.box import Boxes
from entrack.cli.console import new_app
from entrack.cli.tracking import Summary, run
from entrack.datasets.frames import Image
from entrack.datasets.texts import parse_table
from entrack.draw import filmstrip
from entrack.evaluation.ope import auc, overlaps, success_curve
from entrack.files import write_bytes, writing
from entrack.model import assets
from entrack.run import Recorder
from entrack.tracker import Estimate
from entrack.video import Frame, open_source

app = new_app()
_SHOWN = 8  # frames of the filmstrip


@app.command()
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for what comes out.")] = Path(
        "entrack-demo"
    ),
) -> None:
    """Track the embedded clip: an annotated video, its boxes, a filmstrip and the score.

    \b
    entrack demo
    entrack demo --out somewhere
    """  # noqa: D301
    clip = assets() / "demo" / "clip.mp4"
    known = clip.with_suffix(".txt")
    truth = parse_table(known.read_text(), [4], known.name)
    chosen = np.linspace(0, len(truth) - 1, _SHOWN).round().astype(int)
    boxes: list[Boxes] = []
    images: list[Image] = []

    def keep(frame: Frame, estimates: list[Estimate]) -> None:
        boxes.append(estimates[0].box)
        if frame.index in chosen:
            images.append(frame.image)

    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    tracker = entrack.load()
    with open_source(clip) as source:
        recorder = Recorder(out / "boxes.csv", out / "tracked.mp4", fps=source.fps)
        summary = Summary(source.name, recorder.paths)
        run(tracker, source, [truth[0]], recorder, summary, keep)
    overlap = overlaps(truth, boxes)
    labels = [f"frame {i}   IoU {overlap[i]:.2f}" for i in chosen]
    strip = filmstrip(images, np.array(boxes)[chosen], truth[chosen], labels)
    summary.files.append(out / "filmstrip.png")
    write_bytes(summary.files[-1], cv2.imencode(".png", strip)[1].tobytes())
    typer.echo(summary)
    typer.echo(f"AUC {auc(success_curve(overlap)):.3f} against the clip's known boxes (otb)")
