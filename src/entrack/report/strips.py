"""Filmstrips: frames of a sequence with every tracker's region on them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack import box as boxes_
from entrack.datasets import Dataset, open_dataset
from entrack.datasets import Sequence as Video
from entrack.datasets.frames import Image
from entrack.draw import filmstrip
from entrack.errors import EntrackError
from entrack.evaluation.raw import Results
from entrack.report.metrics import SUPERVISED, by_sequence
from entrack.report.runs import Result, Section
from entrack.report.style import Style
from entrack.report.tables import worst_first

_FRAMES, _CELL = 4, 396  # frames a strip, and their width in pixels
_WIDTH = _FRAMES * _CELL + 18
_WHITE, _DARK = (255, 255, 255), (28, 28, 28)
_TAG = 15

Corners = NDArray[np.float64]
"""(T, 4, 2) corners of a region a frame; NaN where there is none."""


@dataclass(frozen=True)
class Strip:
    """A picture of one sequence, and what is to be said of it."""

    name: str
    sequence: str
    caption: str
    jpeg: bytes


def chosen(section: Section, wanted: Sequence[str]) -> list[str]:
    """Sequences to show: those wanted, or the worst two and the one that divides trackers most."""
    if wanted:
        return [name for name in wanted if name in section.sequences]
    metric = by_sequence(section.protocol)[0]

    def spread(name: str) -> float:
        values = [v for r in section.results if (v := r.value(metric, name)) is not None]
        return max(values) - min(values) if values else 0.0

    divides = max(section.sequences, key=spread)
    return list(dict.fromkeys([*worst_first(section, metric)[:2], divides]))


def filmstrips(
    section: Section, styles: dict[str, Style], wanted: Sequence[str]
) -> tuple[list[Strip], str]:
    """Draw the chosen sequences; where that cannot be done, one sentence says why."""
    names, why = chosen(section, wanted), ""
    for place in dict.fromkeys(result.about["place"] for result in section.results):
        try:
            dataset = open_dataset(f"{section.format}:{place}")
            return [_strip(section, dataset, dataset.read(name), styles) for name in names], ""
        except EntrackError as error:
            why = f"No filmstrips: {error}."
    return [], why


def _strip(section: Section, dataset: Dataset, video: Video, styles: dict[str, Style]) -> Strip:
    if not len(video.frames):
        raise EntrackError(f"{dataset.root} holds no pictures of {video.name}")
    truth = _corners(video.boxes if video.polygons is None else video.polygons)
    drawn, missing = dict[str, Corners](), list[str]()
    for result in section.results:
        try:
            drawn[result.tracker] = _regions(result, section, dataset, video)
        except EntrackError:
            missing.append(result.tracker)
    at = np.linspace(0, len(video) - 1, _FRAMES + 1).astype(int)[1:]
    cells = [_cell(video.frames[int(t)], int(t), truth, drawn, styles) for t in at]
    picture = filmstrip(
        cells, np.full((_FRAMES, 4), np.nan), labels=[f"frame {t + 1}" for t in at],
        columns=_FRAMES, width=_WIDTH,
    )  # fmt: skip
    caption = "White: ground truth."
    if missing:
        caption += f" Without boxes that can be read: {', '.join(missing)}."
    jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    name = re.sub(r"[^\w.+-]+", "-", f"{section.name}-{video.name}")
    return Strip(name, video.name, caption, jpeg)


def _regions(result: Result, section: Section, dataset: Dataset, video: Video) -> Corners:
    results = Results(result.raw)
    if not results.files(video.name):
        raise EntrackError(f"{result.raw} has no results for {video.name}")
    if section.protocol in SUPERVISED:
        return _corners(results.trajectories(video.name)[0].regions.corners)
    return _corners(results.boxes(video, dataset)[0])


def _corners(regions: NDArray[np.float64]) -> Corners:
    if regions.shape[1] == 8:
        return regions.reshape(-1, 4, 2)
    corners = boxes_.to_corners(regions)
    return corners[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]


def _cell(
    image: Image, t: int, truth: Corners, drawn: dict[str, Corners], styles: dict[str, Style]
) -> Image:
    scale = _CELL / image.shape[1]
    height = round(image.shape[0] * scale)
    cell = np.asarray(cv2.resize(image, (_CELL, height), interpolation=cv2.INTER_AREA), np.uint8)
    _outline(cell, truth[t] * scale, _WHITE)
    present = [(styles[n], c[t] * scale) for n, c in drawn.items() if t < len(c)]
    present = [(style, corners) for style, corners in present if np.isfinite(corners).all()]
    for style, corners in reversed(present):
        _outline(cell, corners, style.bgr)
    taken: list[tuple[int, int]] = []
    for style, corners in present:
        _tag(cell, corners, style, taken)
    return cell


def _outline(cell: Image, corners: Corners, colour: tuple[int, int, int]) -> None:
    # Far outside, coordinates would not fit into OpenCV's integers.
    points = np.round(np.clip(corners, -10_000, 10_000)).astype(np.int32)
    for ink, width in ((_DARK, 4), (colour, 2)):
        cv2.polylines(cell, [points], True, ink, width, cv2.LINE_AA)


def _tag(cell: Image, corners: Corners, style: Style, taken: list[tuple[int, int]]) -> None:
    """The tracker's letter over its box, or beside a letter that is there already."""
    wide = _TAG * len(style.letter)
    left, top = np.clip(corners, -10_000, 10_000).min(axis=0)
    x = int(np.clip(left, 0, cell.shape[1] - wide))
    y = int(np.clip(top - _TAG - 2, 0, cell.shape[0] - _TAG))
    while any(abs(x - u) <= wide and abs(y - v) <= _TAG for u, v in taken):
        x += 1
    taken.append((x, y))
    cv2.rectangle(cell, (x, y), (x + wide - 1, y + _TAG - 1), style.bgr, cv2.FILLED)
    at = (x + 3, y + _TAG - 4)
    cv2.putText(cell, style.letter, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, _DARK, 1, cv2.LINE_AA)
