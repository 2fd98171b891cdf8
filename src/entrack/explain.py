"""The way of a frame as a figure for a paper, or a film: frame, search window, Z, z, M, box."""

import io
import json
from collections.abc import Generator
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch, Rectangle

from entrack import box as boxes_
from entrack.box import Boxes
from entrack.datasets import open_dataset
from entrack.datasets.frames import Image
from entrack.errors import EntrackError
from entrack.files import write_bytes
from entrack.filter import Features
from entrack.looks import principal
from entrack.peers import parse
from entrack.run import follow
from entrack.tracker import Estimate, Look, Tracker
from entrack.video import Frame, Source, VideoWriter
from entrack.window import Window, crop

FIGURES, FILM = (".png", ".pdf", ".svg"), ".mp4"
_ORANGE, _QUIET = "#e69f00", "#656d76"
_SIDE = 1.75  # inches of a square panel
_RC: Any = {"font.size": 8, "axes.titlesize": 9, "svg.fonttype": "none"}


class Way:
    """A figure of one row: what the frame is turned into, from left to right."""

    def __init__(self, frame: Frame, estimate: Estimate, look: Look) -> None:
        height, width = frame.image.shape[:2]
        ratio = float(np.clip(width / height, 0.6, 2))
        self._z = _z(look) is not None
        names = ["frame", "search window", "features Z", *["z"] * self._z, "response M", "box"]
        widths = [ratio, *[1.0] * (len(names) - 1)]
        size = (_SIDE * sum(widths) + 0.28 * len(names), _SIDE + 0.55)
        with matplotlib.rc_context(_RC):
            self.figure = Figure(size, dpi=200, layout="constrained")
            FigureCanvasAgg(self.figure)
            axes = cast(list[Axes], self.figure.subplots(1, len(names), width_ratios=widths))
            self._axes = dict(zip(names, axes, strict=True))
            for name, panel in self._axes.items():
                panel.set_title(name)
                panel.set_xticks([])
                panel.set_yticks([])
            self.draw(frame, estimate, look)
            self._join(axes)

    def draw(self, frame: Frame, estimate: Estimate, look: Look) -> None:
        """Show another frame of the same size."""
        x, y, w, h = estimate.search.tolist()
        window = Window(x, y, w, h, look.patch.shape[0])
        rgb = _small(frame.image)[:, :, ::-1]
        height, width = frame.image.shape[:2]
        for panel in self._axes.values():
            while panel.images or panel.patches or panel.lines:
                (panel.images or panel.patches or panel.lines)[0].remove()
        self._show("frame", rgb, f"{width}×{height}, frame {frame.index}", (0, width, height, 0))
        self._rectangle("frame", estimate.search, linestyle="--", width=1)
        self._rectangle("frame", estimate.box)
        patch = crop(frame.image, window)[:, :, ::-1]  # the look's own may be zoomed a little
        self._show("search window", patch, f"{window.size}×{window.size} pixels")
        n, channels = look.features.shape[-1], look.features.shape[0]
        self._show("features Z", principal(look.features), f"{n}×{n}×{channels}, as 3 colours")
        z = _z(look)
        if self._z and z is not None:
            self._show("z", principal(z) if len(z) >= 3 else z[0], "×".join(map(str, z.shape)))
        self._response(look.response)
        self._show("box", patch, f"score {estimate.score:.2f}" + ", lost" * estimate.lost)
        self._rectangle("box", window.to_patch(estimate.box))
        if estimate.sigma is not None:
            self._band(window, estimate)

    def _response(self, response: Features) -> None:
        n = response.shape[-1]
        self._show("response M", response, f"{n}×{n}, peak {response.max():.2f}")
        self._axes["response M"].images[0].set(cmap="inferno", clim=(0, 1))
        i, j = np.unravel_index(int(response.argmax()), response.shape)
        self._axes["response M"].plot(j, i, "+", color="white", markersize=7)

    def _band(self, window: Window, estimate: Estimate) -> None:
        """The policy's mean plus and minus its standard deviation, side by side."""
        out = np.asarray(estimate.sigma) * [-1, -1, 1, 1]
        for sign in (-1, 1):
            edge = boxes_.from_corners(boxes_.to_corners(estimate.box) + sign * out)
            self._rectangle("box", window.to_patch(edge), linestyle=":", width=1)

    def _show(self, name: str, picture: Any, words: str, extent: Any = None) -> None:
        panel = self._axes[name]
        panel.imshow(picture, extent=extent, interpolation="nearest")
        panel.set_xlabel(words, color=_QUIET)

    def _rectangle(self, name: str, box: Boxes, linestyle: str = "-", width: float = 1.5) -> None:
        x, y, w, h = box
        look: Any = {"fill": False, "color": _ORANGE, "linestyle": linestyle, "linewidth": width}
        self._axes[name].add_patch(Rectangle((x, y), w, h, **look))

    def _join(self, axes: list[Axes]) -> None:
        """Arrows from panel to panel."""
        for left, right in pairwise(axes):
            arrow = ConnectionPatch(
                (1.0, 0.5),
                (0.0, 0.5),
                coordsA=left.transAxes,
                coordsB=right.transAxes,
                arrowstyle="-|>",
                color=_QUIET,
            )
            self.figure.add_artist(arrow)

    def pixels(self) -> Image:
        """The figure as a picture (H, W, 3) BGR."""
        canvas = cast(FigureCanvasAgg, self.figure.canvas)
        canvas.draw()
        return cast(Image, cv2.cvtColor(np.asarray(canvas.buffer_rgba()), cv2.COLOR_RGBA2BGR))

    def save(self, path: Path) -> None:
        """Write it as .png, .pdf or .svg."""
        with matplotlib.rc_context(_RC):
            data = io.BytesIO()
            self.figure.savefig(data, format=path.suffix[1:].lower())
        write_bytes(path, data.getvalue())


def explain(
    tracker: Tracker, source: Source, box: Boxes, out: Path, frame: int | None = None
) -> Generator[int, None, None]:
    """Write a figure of frame `frame`, or a film of all frames, as `out` ends; yield each index.

    Raises
    ------
    EntrackError
        For another ending, or if the source ends before `frame`, or after its first frame.
    """
    if out.suffix.lower() not in (*FIGURES, FILM):
        raise EntrackError(f"explained as {' '.join((*FIGURES, FILM))}, found {out.name}")
    with closing(follow(tracker, source, [box])) as steps:
        seen = ((f, e, look) for f, [e] in steps for look in tracker.looks if look is not None)
        if out.suffix.lower() == FILM:
            yield from _film(out, source.fps, seen)
            return
        for image, estimate, look in seen:
            yield image.index
            if image.index >= (frame or 0):
                Way(image, estimate, look).save(out)
                return
    raise EntrackError(f"{source.name} ends before frame {frame}")


def of_run(result: Path) -> tuple[Source, Boxes, str]:
    """From a result file of `entrack evaluate`: its sequence, the first box, and the model.

    Raises
    ------
    EntrackError
        If the file lies in no run's folder, or its tracker is no model of entrack.
    """
    tracker, dataset = result.parent / "run.json", result.parents[1] / "dataset.json"
    if not (tracker.is_file() and dataset.is_file()):
        raise EntrackError(f"{result} is no result of a run: expected RUN/DATASET/TRACKER/NAME.txt")
    spec, data = (json.loads(path.read_text("utf-8")) for path in (tracker, dataset))
    if parse(spec["spec"]).kind != "model":
        raise EntrackError(f"only models of entrack can be explained, found {spec['spec']}")
    opened = open_dataset(f"{data['format']}:{data['place']}")
    if result.stem not in opened.names:
        raise EntrackError(f"{opened.root} has no sequence {result.stem}")
    sequence = opened.read(result.stem)
    frames = (Frame(i, i / 25, image) for i, image in enumerate(sequence.frames))
    return Source(sequence.name, frames, 25, len(sequence)), sequence.boxes[0], spec["spec"]


def _film(
    out: Path, fps: float, seen: Generator[tuple[Frame, Estimate, Look], None, None]
) -> Generator[int, None, None]:
    way = None
    with VideoWriter(out, fps) as video:
        for frame, estimate, look in seen:
            way = way or Way(frame, estimate, look)
            way.draw(frame, estimate, look)
            video.write(way.pixels(), frame.time)
            yield frame.index


def _z(look: Look) -> Features | None:
    """f1(Z) (C, n, n) of a model with a policy (eq. 4)."""
    return look.z


def _small(image: Image) -> Image:
    """A picture not finer than it is printed."""
    scale = 900 / max(image.shape[:2])
    if scale >= 1:
        return image
    return cast(Image, cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
