"""HTML and SVG of the page: numbers in, text out, nothing that a user typed."""

import base64
from collections.abc import Mapping, Sequence
from typing import cast

import cv2
import numpy as np
from numpy.typing import ArrayLike

from entrack.box import to_corners
from entrack.datasets.frames import Image
from entrack.draw import PALETTE
from entrack.tracker import Estimate

_WIDEST = 1280  # pixels of a picture that is shown; the tracker sees all of it
_POINTS = 400  # of a curve; more than that is finer than the page's pixels


def colour(number: int) -> str:
    """Colour of object `number`, from 0, as in the annotated video.

    >>> colour(0)
    '#e69f00'
    """
    blue, green, red = PALETTE[number % len(PALETTE)]
    return f"#{red:02x}{green:02x}{blue:02x}"


def jpeg(image: Image) -> bytes:
    """A picture (H, W, 3) BGR as a JPEG of a size that is quick to show."""
    scale = _WIDEST / max(image.shape[:2])
    if scale < 1:
        image = cast(Image, cv2.resize(image, None, fx=scale, fy=scale))
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


def data_url(image: Image, number: int = 0) -> str:
    """A picture as an address that holds it; another number makes another address of it."""
    return f"data:image/jpeg;n={number};base64,{base64.b64encode(jpeg(image)).decode()}"


def boxes(estimates: Sequence[Estimate | None], size: tuple[int, int]) -> str:
    """Each object's box, with its number; its search window, its σ band, dashes if it is lost."""
    html: list[str] = []
    for number, estimate in enumerate(estimates):
        if estimate is None:
            continue
        ink = f"--ink:{colour(number)}"
        if not np.array_equal(estimate.search, estimate.box):
            html.append(f'<div class="search" style="{_place(estimate.search, size)};{ink}"></div>')
        if estimate.sigma is not None:
            html.append(f'<div class="band" style="{_band(estimate, size)};{ink}"></div>')
        word = f"{number + 1} lost" if estimate.lost else f"{number + 1}"
        html.append(
            f'<div class="box{" lost" * estimate.lost}" style="{_place(estimate.box, size)};{ink}">'
            f"<b>{word}</b></div>"
        )
    return "".join(html)


def drawn(box: ArrayLike, size: tuple[int, int], number: int) -> str:
    """The box that is being drawn."""
    return f'<div class="box drawn" style="{_place(box, size)};--ink:{colour(number)}"></div>'


def _place(box: ArrayLike, size: tuple[int, int]) -> str:
    x, y, w, h = 100 * np.asarray(box, np.float64) / np.tile(size, 2)
    return f"left:{x:.3f}%;top:{y:.3f}%;width:{w:.3f}%;height:{h:.3f}%"


def _band(estimate: Estimate, size: tuple[int, int]) -> str:
    """From σ outside each side to σ inside: a rectangle with a hole."""
    out = np.asarray(estimate.sigma, np.float64) * [-1, -1, 1, 1]
    low_x, low_y, high_x, high_y = to_corners(estimate.box) + out
    inner = to_corners(estimate.box) - out
    span = np.tile([high_x - low_x, high_y - low_y], 2)
    x0, y0, x1, y1 = np.clip(100 * (inner - [low_x, low_y, low_x, low_y]) / span, 0, 100)
    place = _place([low_x, low_y, high_x - low_x, high_y - low_y], size)
    hole = f"{x0:.1f}% {y0:.1f}%,{x0:.1f}% {y1:.1f}%,{x1:.1f}% {y1:.1f}%,{x1:.1f}% {y0:.1f}%"
    return (
        f"{place};clip-path:polygon(evenodd,0 0,100% 0,100% 100%,0 100%,0 0,"
        f"{hole},{x0:.1f}% {y0:.1f}%)"
    )


def chart(tracks: Sequence[Mapping[int, Estimate]], length: int) -> str:
    """Score of each object over the frames of the video, and where it was lost."""
    end = max(length - 1, 1)
    marks: list[str] = []
    for number, track in enumerate(tracks):
        frames = sorted(track)
        lost = [i for i in frames if track[i].lost]
        for first, last in _runs(lost):
            left, right = max(0, first - 0.5), min(end, last + 0.5)
            marks.append(
                f'<rect class="lost" x="{1000 * left / end:.1f}" '
                f'width="{1000 * (right - left) / end:.1f}" '
                f'y="{106 + 6 * number}" height="5" fill="{colour(number)}"/>'
            )
        for first, last in _runs(frames):
            step = max(1, (last - first) // _POINTS)
            shown = dict.fromkeys([*range(first, last, step), last])
            points = " ".join(
                f"{1000 * i / end:.1f},{100 - 100 * track[i].score:.1f}" for i in shown
            )
            marks.append(f'<polyline points="{points}" stroke="{colour(number)}"/>')
    height = 110 + 6 * len(tracks)
    grid = "".join(f'<line x2="1000" y1="{y}" y2="{y}"/>' for y in (0, 50, 100))
    return (
        f'<svg viewBox="0 -4 1000 {height}" preserveAspectRatio="none" role="img" '
        f'aria-label="Score over time">{grid}{"".join(marks)}</svg>'
    )


def _runs(frames: Sequence[int]) -> list[tuple[int, int]]:
    """First and last of each run of neighbours.

    >>> _runs([1, 2, 3, 7])
    [(1, 3), (7, 7)]
    """
    found: list[tuple[int, int]] = []
    for index in frames:
        if found and index == found[-1][1] + 1:
            found[-1] = (found[-1][0], index)
        else:
            found.append((index, index))
    return found


def words(estimate: Estimate | None) -> str:
    """What to say of an object in one frame."""
    if estimate is None:
        return "not in this frame"
    if estimate.lost:
        return "LOST"
    sigma = "" if estimate.sigma is None else f" ±{float(np.mean(estimate.sigma)):.1f} px"
    return f"{estimate.score:.0%}{sigma}"
