"""Procedural pictures: surfaces with the statistics of photographs, and organic shapes.

Natural pictures have a 1/f spectrum and consist of things that hide other things. A "dead leaves"
picture (shapes of power-law sizes thrown upon each other) with 1/f noise on it has both.
"""

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from entrack.datasets.frames import Image

Field = NDArray[np.float32]
Colours = NDArray[np.float32]

_GROUND = (18, 28, 38, 50, 75, 100, 120, 205, 215)
"""Hues of earth, wood, sand, grass, leaves, water and sky, in degrees."""


def noise(rng: Generator, height: int, width: int, slope: float = 1.0) -> Field:
    """A field (height, width) of 1/f^slope noise with mean 0 and deviation 1."""
    fy, fx = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None]
    amplitude = np.maximum(np.hypot(fy, fx), 1 / max(height, width)) ** -slope
    amplitude[0, 0] = 0
    phase = rng.uniform(0, 2 * np.pi, amplitude.shape)
    field = np.fft.irfft2(amplitude * np.exp(1j * phase), (height, width))
    return (field / field.std()).astype(np.float32)


def palette(rng: Generator, hues: ArrayLike, saturation: tuple[float, float]) -> Colours:
    """BGR colours (K, 3) around the given hues (K,) in degrees, dark to bright in random order."""
    base = np.asarray(hues, np.float64)
    hue = (base / 2 + rng.normal(0, 5, len(base))) % 180
    strength = rng.uniform(*saturation, len(base)) * 255
    value = rng.permutation(np.linspace(rng.uniform(35, 80), rng.uniform(170, 240), len(base)))
    hsv = np.stack([hue, strength, value], axis=1)[None].astype(np.uint8)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)[0].astype(np.float32)


def surface(rng: Generator, height: int, width: int, colours: Colours, leaves: int) -> Image:
    """A picture (height, width, 3) of `leaves` shapes upon each other in the given colours."""
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = colours[rng.integers(len(colours))]
    extent = float(np.hypot(height, width))
    radii = extent * np.minimum(0.25, 0.01 * (1 - rng.random(leaves)) ** -0.75)
    for radius in radii:
        at = rng.uniform((0, 0), (width, height))
        points = at + radius * outline(rng, 16)
        colour = colours[rng.integers(len(colours))] + rng.normal(0, 10, 3)
        cv2.fillPoly(picture, _corners(points, 4), colour.tolist(), cv2.LINE_AA, 4)
    # Leaves keep a hard edge, the world does not: a lens has its blur.
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7)
    grain = 1 + 0.16 * noise(rng, height, width, rng.uniform(0.9, 1.4))
    light = 1 + 0.18 * cv2.resize(
        noise(rng, 12, 12, 1.5), (width, height), interpolation=cv2.INTER_CUBIC
    )
    return np.clip(picture * (grain * light)[..., None], 0, 255).astype(np.uint8)


def backdrop(rng: Generator, width: int, height: int) -> Image:
    """A background (height, width, 3): muted colours, many things, soft light."""
    colours = palette(rng, np.repeat(rng.choice(_GROUND, 3), 3), (0.08, 0.5))
    return surface(rng, height, width, colours, int(rng.integers(150, 600)))


def outline(rng: Generator, count: int = 64) -> NDArray[np.float64]:
    """Corners (count, 2) of an organic closed shape around 0, about one unit in radius.

    An ellipse, a blob, a rounded polygon or a rounded box, of an aspect between 1:2 and 2:1.
    """
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    kind = rng.choice(["ellipse", "blob", "polygon", "box"])
    radius = np.ones(count)
    if kind == "blob":
        for k in range(2, 6):
            radius += rng.normal(0, 0.22 / k) * 1.6 * np.cos(k * angle + rng.uniform(0, 2 * np.pi))
    elif kind == "polygon":
        sides = rng.integers(3, 8)
        inner = np.cos(np.pi / sides)
        turned = (angle + rng.uniform(0, 2 * np.pi)) % (2 * np.pi / sides) - np.pi / sides
        radius = np.minimum(inner / np.cos(turned), rng.uniform(0.9, 0.98))
    elif kind == "box":
        power = rng.uniform(3, 8)
        radius = (np.abs(np.cos(angle)) ** power + np.abs(np.sin(angle)) ** power) ** (-1 / power)
    aspect = np.exp(rng.uniform(-0.35, 0.35))
    tilt = rng.uniform(0, np.pi) if kind != "box" else 0.0
    points = np.maximum(radius, 0.3)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points *= aspect, 1 / aspect
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    return points @ turn.T


def mask(points: NDArray[np.float64], size: int) -> Image:
    """Fill an outline, fitted into a square of `size` pixels: alpha with a soft edge."""
    low, high = points.min(axis=0), points.max(axis=0)
    fitted = (points - (low + high) / 2) * (size - 8) / float((high - low).max()) + size / 2 - 0.5
    alpha = np.zeros((size, size), np.uint8)
    cv2.fillPoly(alpha, _corners(fitted, 8), [255], cv2.LINE_AA, 8)
    return cv2.GaussianBlur(alpha, (0, 0), 0.8)  # pyright: ignore


def shaded(picture: Image, alpha: Image, light: NDArray[np.float64]) -> Image:
    """Shade a flat picture as if it were a pillow, lit from `light` (2,) in picture coordinates."""
    height = np.sqrt(cv2.distanceTransform((alpha > 127).astype(np.uint8), cv2.DIST_L2, 5))
    height = cv2.GaussianBlur(height, (0, 0), alpha.shape[0] / 40)
    slope = (
        cv2.Sobel(height, cv2.CV_32F, 1, 0) * light[0]
        + cv2.Sobel(height, cv2.CV_32F, 0, 1) * light[1]
    )
    gain = np.clip(1 - 0.28 * slope, 0.45, 1.5)
    return np.clip(picture * gain[..., None], 0, 255).astype(np.uint8)


def cutout(rng: Generator, size: int, picture: Image | None = None) -> Image:
    """A thing (size, size, 4), straight BGRA: an organic shape, from `picture` or made up."""
    alpha = mask(outline(rng), size)
    if picture is None:
        hue, accent = rng.uniform(0, 360, 2)
        colours = palette(rng, [hue, hue, hue, hue, accent, accent], (0.3, 0.95))
        picture = surface(rng, size, size, colours, int(rng.integers(15, 60)))
    else:
        picture = crop(rng, picture, size, size)
    light = np.array([0.6, 0.8])
    return np.dstack([shaded(picture, alpha, light), alpha])


def board(rng: Generator, width: int, height: int, picture: Image | None = None) -> Image:
    """A solid thing (height, width, 4), straight BGRA: a rectangle with round corners."""
    if picture is None:
        colours = palette(rng, np.repeat(rng.choice(_GROUND), 4), (0.05, 0.45))
        picture = surface(rng, height, width, colours, int(rng.integers(5, 40)))
    else:
        picture = crop(rng, picture, width, height)
    alpha = np.zeros((height, width), np.uint8)
    radius = max(min(width, height) // 12, 1)
    cv2.rectangle(alpha, (radius, radius), (width - 1 - radius, height - 1 - radius), 255, -1)
    round_ = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    alpha = cv2.dilate(alpha, round_)
    across = np.linspace(-1, 1, width, dtype=np.float32)
    gain = 1.08 - 0.1 * across - 0.3 * across**4
    lit = np.clip(picture * gain[:, None], 0, 255).astype(np.uint8)
    return np.dstack([lit, alpha])  # pyright: ignore[reportReturnType]


def crop(rng: Generator, picture: Image, width: int, height: int) -> Image:
    """A random part of `picture` of the wanted shape, at least half its extent, resized."""
    h, w = picture.shape[:2]
    scale = rng.uniform(0.5, 1.0) * min(w / width, h / height)
    cut_w, cut_h = max(int(width * scale), 1), max(int(height * scale), 1)
    y, x = rng.integers([h - cut_h + 1, w - cut_w + 1]).tolist()
    part = picture[y : y + cut_h, x : x + cut_w]
    how = cv2.INTER_AREA if scale > 1 else cv2.INTER_CUBIC
    return cv2.resize(part, (width, height), interpolation=how)  # pyright: ignore


def _corners(points: NDArray[np.float64], bits: int) -> list[NDArray[np.int32]]:
    """A polygon for cv2, in pixels with `bits` binary places."""
    return [np.round(points * 2**bits).astype(np.int32)]
