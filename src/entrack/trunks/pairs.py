"""Pairs of views of one target, for fine-tuning a trunk through the filter."""

import math
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from entrack.box import Boxes, area, centre, clip, from_centre
from entrack.config import WindowConfig
from entrack.datasets.sequence import Sequence
from entrack.trunks.crops import Image, grey, photometric
from entrack.window import around, crop


@checked(frozen=True, config=ConfigDict(extra="forbid"))
class PairConfig:
    """What the two views of a pair may differ by."""

    shift: float = 0.35
    """Standard deviation of the window's offset from the target, in target sizes."""
    furthest: float = 1.1
    """Largest offset, in target sizes."""
    zoom: float = 0.12
    """Standard deviation of the logarithm of the window's scale against the target's."""
    aspect: float = 0.0
    """Standard deviation of the logarithm of its aspect ratio against the target's."""
    frames: int = 60
    """Most frames between the two views of a clip."""
    rotation: float = 15.0
    """Standard deviation of the rotation between two views of a still, degrees."""
    replace: float = 0.6
    """Share of stills whose target is moved to another background."""
    occlude: float = 0.2
    """Share of search patches with something in front of the target."""
    window: WindowConfig = Field(default_factory=WindowConfig)
    """What the patches are cut by."""


@dataclass(frozen=True)
class Pair:
    """A template patch, a search patch, and where the target is in the latter."""

    template: Image
    search: Image
    offset: tuple[float, float]
    """(dx, dy) of the target from the centre of the search patch, in shares of its side."""
    zoom: float
    """Size of the search window against the one that fits the target: 1 is right."""
    box: Boxes
    """The target (4,) in the search patch, in shares of its side."""
    held: Boxes
    """The box that the search window was laid around (4,): width and height, likewise, and the
    logarithms of both in units of the target in the template."""
    roi: Boxes
    """The target (4,) in the template patch, likewise."""


def _displaced(box: Boxes, config: PairConfig, rng: np.random.Generator) -> tuple[Boxes, float]:
    """A box of wrong place and size, as a tracker holds before it looks; and its zoom."""
    side = np.sqrt(box[2] * box[3])
    shift = np.clip(rng.normal(0, config.shift, 2), -config.furthest, config.furthest) * side
    zoom = float(np.exp(rng.normal(0, config.zoom)))
    size = box[2:] * zoom
    if config.aspect:
        stretch = np.exp(rng.normal(0, config.aspect / 2))
        size = size * [stretch, 1 / stretch]
    return from_centre(centre(box) + shift, size), zoom


def _pair(
    template: Image,
    shape: Boxes,
    frame: Image,
    box: Boxes,
    config: PairConfig,
    rng: np.random.Generator,
) -> Pair:
    """Look for the target, which is at `box` of `frame`, from a displaced window.

    `shape` is the target's size (2,) where the template was cut out.
    """
    looked, zoom = _displaced(box, config, rng)
    window = around(looked, config.window)
    offset = (centre(box) - centre(window.box)) / window.box[2:]
    search = photometric(crop(frame, window, config.window.border), rng)
    seen = window.to_patch(box) / window.size
    if rng.random() < 0.5:
        template, search, offset = template[:, ::-1], search[:, ::-1], offset * [-1, 1]
        seen[0] = 1 - seen[0] - seen[2]
    if rng.random() < 0.1:
        template, search = grey(template), grey(search)
    held = np.concatenate([looked[2:] / window.box[2:], np.log(looked[2:] / shape)])
    around_template = around(from_centre([0, 0], shape), config.window)
    roi = from_centre([0.5, 0.5], shape / around_template.box[2:])
    place = (float(offset[0]), float(offset[1]))
    return Pair(photometric(template, rng), search, place, zoom, seen, held, roi)


def from_sequence(sequence: Sequence, config: PairConfig, rng: np.random.Generator) -> Pair | None:
    """Two frames of one sequence; None where the drawn frames do not show the target."""
    first = int(rng.integers(len(sequence)))
    low, high = max(0, first - config.frames), min(len(sequence), first + config.frames + 1)
    second = int(rng.integers(low, high))
    boxes = sequence.boxes[[first, second]]
    if not np.isfinite(boxes).all() or (boxes[:, 2:] < 4).any():
        return None
    absent = sequence.absent
    if len(absent) and (absent[first] or absent[second]):
        return None
    image = sequence.frames[first]
    if area(clip(boxes[0], image.shape[1], image.shape[0])) < 0.6 * area(boxes[0]):
        return None
    template = crop(image, around(boxes[0], config.window), config.window.border)
    return _pair(template, boxes[0, 2:], sequence.frames[second], boxes[1], config, rng)


def from_still(
    image: Image, others: SequenceOf[Image], config: PairConfig, rng: np.random.Generator
) -> Pair:
    """Any rectangle of a still as target; seen again turned, elsewhere, or half hidden."""
    height, width = image.shape[:2]
    side = math.exp(rng.uniform(math.log(20), math.log(0.5 * min(height, width))))
    aspect = np.exp(rng.normal(0, 0.4))
    size = np.minimum(side * np.array([np.sqrt(aspect), 1 / np.sqrt(aspect)]), [width, height])
    box = from_centre(size / 2 + rng.uniform(0, 1, 2) * (np.array([width, height]) - size), size)
    template = crop(image, around(box, config.window), config.window.border)
    frame, moved = _turn(image, box, config, rng)
    if rng.random() < config.replace:
        frame = _transplant(frame, moved, others[int(rng.integers(len(others)))])
    if rng.random() < config.occlude:
        frame = _occlude(frame, moved, others[int(rng.integers(len(others)))], rng)
    return _pair(template, size, frame, moved, config, rng)


def _turn(
    image: Image, box: Boxes, config: PairConfig, rng: np.random.Generator
) -> tuple[Image, Boxes]:
    """Rotate, scale and stretch a still about the target; its new box keeps the same extent."""
    angle = np.deg2rad(rng.normal(0, config.rotation))
    scale = np.exp(rng.normal(0, 0.15)) * np.exp(rng.normal(0, 0.07) * np.array([1, -1]))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = scale[:, None] * turn
    matrix = np.hstack([linear, (centre(box) - linear @ centre(box))[:, None]])
    size = (image.shape[1], image.shape[0])
    turned = cv2.warpAffine(image, matrix, size, borderMode=cv2.BORDER_REFLECT_101)
    return cast(Image, turned), from_centre(centre(box), box[2:] * scale)


def _transplant(image: Image, box: Boxes, ground: Image) -> Image:
    """Keep the ellipse inside `box`, softly, on another picture."""
    height, width = image.shape[:2]
    ground = cast(Image, cv2.resize(ground, (width, height), interpolation=cv2.INTER_AREA))
    (cx, cy), (a, b) = centre(box).tolist(), (box[2:] / 2).tolist()
    y, x = np.ogrid[:height, :width]
    radius = np.sqrt(((x + 0.5 - cx) / a) ** 2 + ((y + 0.5 - cy) / b) ** 2)
    alpha = np.clip((1.1 - radius) / 0.2, 0, 1).astype(np.float32)[..., None]
    return (alpha * image + (1 - alpha) * ground).astype(np.uint8)


def _occlude(image: Image, box: Boxes, other: Image, rng: np.random.Generator) -> Image:
    """Cover up to half of the target with a piece of another picture."""
    height, width = image.shape[:2]
    horizontal = rng.random() < 0.5
    share = rng.uniform(0.2, 0.5)
    size = box[2:] * ([share, 1.2] if horizontal else [1.2, share])
    place = centre(box) + rng.uniform(-0.5, 0.5, 2) * box[2:]
    x0, y0 = np.clip(place - size / 2, 0, [width - 2, height - 2]).astype(int)
    w, h = (int(v) for v in np.clip(size, 2, [width - x0, height - y0]))
    h, w = min(h, other.shape[0]), min(w, other.shape[1])
    result = image.copy()
    result[y0 : y0 + h, x0 : x0 + w] = other[:h, :w]
    return result


def labels(pairs: SequenceOf[Pair], cells: int, sigma: float, spread: float) -> NDArray[np.float32]:
    """The responses that the filter should give, (N, cells, cells).

    A Gaussian of `sigma` cells at the true offset, lower where the window's scale is wrong: its
    height is exp(−½ (log zoom / spread)²), so that the right one of several scales answers most.
    """
    d = np.arange(cells) - cells // 2
    maps: list[NDArray[np.float32]] = []
    for pair in pairs:
        ox, oy = pair.offset[0] * cells, pair.offset[1] * cells
        gx, gy = (np.exp(-((d - o) ** 2) / (2 * sigma**2)) for o in (ox, oy))
        height = np.exp(-0.5 * (np.log(pair.zoom) / spread) ** 2)
        maps.append((height * gy[:, None] * gx[None, :]).astype(np.float32))
    return np.stack(maps)
