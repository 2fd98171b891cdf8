"""Smooth random tracks: where things are, frame by frame."""

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

Track = NDArray[np.float64]


def spline(control: ArrayLike, length: int) -> Track:
    """Uniform cubic B-spline through the hull of `control` (K ≥ 4, D), sampled to (length, D).

    It is smooth to its second derivative (no jerk of the hand) and stays inside the convex hull of
    its control points, so that bounds on these are bounds on the track.

    >>> spline([[0.0]] * 4, 3).ravel()
    array([0., 0., 0.])
    """
    points = np.asarray(control, np.float64)
    position = np.linspace(0, len(points) - 3, length)
    knot = np.minimum(position.astype(int), len(points) - 4)
    u = position - knot
    weights = np.stack(
        [(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3], axis=1
    )
    return np.einsum("tk,tkd->td", weights / 6, points[knot[:, None] + np.arange(4)])


def wander(rng: Generator, length: int, period: float) -> Track:
    """A smooth random track (length,) that starts at 0 and reaches +1 or −1, never more.

    `period` is roughly how many frames a swing takes.
    """
    knots = 4 + int(np.ceil(length / period))
    track = spline(rng.uniform(-1, 1, (knots, 1)), length)[:, 0]
    track -= track[0]
    return track / max(np.abs(track).max(), 1e-9)


def shake(rng: Generator, length: int, amplitude: float) -> Track:
    """A hand's tremor (length, 2): band-limited noise with a standard deviation of `amplitude`."""
    control = rng.standard_normal((4 + length // 4, 2))
    return amplitude * 1.5 * spline(control, length)  # a spline keeps two thirds of the deviation


def stroll(rng: Generator, low: ArrayLike, high: ArrayLike, steps: ArrayLike) -> Track:
    """A curved path (T, 2) from `low` to `high` (2,), which moves `steps` (T − 1,) pixels a frame.

    The path's shape and the speed along it are separate: a burst of speed follows the same curve.
    """
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    stride = max(0.45 * float(np.min(high - low)), 1.0)
    points = [rng.uniform(low, high)]
    heading = rng.uniform(-np.pi, np.pi)
    for _ in range(6 + int(2.5 * travelled[-1] / stride)):
        heading += rng.normal(0, 0.7)
        ahead = points[-1] + stride * np.array([np.cos(heading), np.sin(heading)])
        if (ahead < low).any() or (ahead > high).any():
            target = rng.uniform(low, high)
            heading = float(np.arctan2(*(target - points[-1])[::-1]))
            ahead = np.clip(
                points[-1] + stride * np.array([np.cos(heading), np.sin(heading)]), low, high
            )
        points.append(ahead)
    curve = spline(points, 24 * len(points))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
    return np.stack([np.interp(travelled, along, curve[:, axis]) for axis in range(2)], axis=1)


def ease(length: int, start: float, end: float, ramp: float) -> Track:
    """0 → 1 → 0 (length,): 1 from frame `start` to `end`, with cosine ramps of `ramp` frames."""
    t = np.arange(length)
    away = np.maximum(np.maximum(start - t, t - end), 0)
    return 0.5 + 0.5 * np.cos(np.pi * np.minimum(away / ramp, 1))
