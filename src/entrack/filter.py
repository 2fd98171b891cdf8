"""The correlation filter, eqs. 1–3 and 14.

Features X and Z are float32 (…, C, n, n), already tapered by `hann` where that is wanted. The label
Y is a Gaussian with its centre at cell [n // 2, n // 2], so a target that has not moved answers
there. Spectra are those of `numpy.fft.rfft2`: complex64 (…, C, n, n // 2 + 1).
"""

from functools import cache
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

_NOTHING = np.float32(1e-20)  # so that a template of zeros has a filter of zeros, and no NaN
Features = NDArray[np.float32]
Spectrum = NDArray[np.complex64]


def hann(n: int, width: float | None = None) -> Features:
    """The periodic cosine window (n, n): 1 in the centre [n // 2, n // 2], 0 at the first edge.

    With a `width` in cells it is 0 from half of that on.
    """
    away = np.minimum(np.abs(np.arange(n) - n / 2) / (width or n), 0.5)
    line = 0.5 + 0.5 * np.cos(2 * np.pi * away)
    return np.outer(line, line).astype(np.float32)


def label(n: int, sigma: float) -> Features:
    """Y: a Gaussian (n, n) of standard deviation `sigma` cells and height 1."""
    d = (np.arange(n) - n // 2) ** 2
    return np.exp(-(d[:, None] + d[None, :]) / (2 * sigma**2)).astype(np.float32)


def spectrum(features: Features) -> Spectrum:
    """The 2D Fourier transform of each channel.

    Two small matrix products, which beat an FFT several times over at 18 × 18.
    """
    rows, columns = _transform(features.shape[-1])
    along_rows = np.matmul(np.asarray(features, np.float32), rows).view(np.complex64)
    return np.matmul(columns, along_rows)


def fit(template: Spectrum, label: Spectrum, regularisation: float) -> Spectrum:
    """Ŵ: the filter that answers Y to the template X (eq. 2, conjugated as eq. 1 asks).

    Parameters
    ----------
    template
        X̂ (…, C, n, n // 2 + 1).
    label
        Ŷ (n, n // 2 + 1).
    regularisation
        λ in units of the mean of Σ_c |X̂_c|², so that it means the same for every trunk.
    """
    energy = (template.real**2 + template.imag**2).sum(axis=-3, keepdims=True)
    floor = regularisation * energy.mean(axis=(-2, -1), keepdims=True) + _NOTHING
    return template.conj() * (label / (energy + floor))


def respond(weights: Spectrum, candidate: Spectrum) -> Features:
    """M: the response (…, n, n) of Ŵ to the candidate Ẑ, summed over channels (eq. 3)."""
    n = weights.shape[-2]
    return cast(Features, np.fft.irfft2((weights * candidate).sum(axis=-3), s=(n, n)))


def update(template: Features, seen: Features, rate: float) -> Features:
    """X_t = (1 − θ) X_{t−1} + θ X'_t (eq. 14)."""
    return cast(Features, (1 - rate) * template + rate * seen)


class Peak(NamedTuple):
    """Where a response is highest, and how clearly."""

    dx: float
    """Offset from the centre to the right, cells."""
    dy: float
    """Offset from the centre downwards, cells."""
    height: float
    psr: float
    """Peak-to-sidelobe ratio: (height − mean) / standard deviation of the rest."""


def peak(response: Features, likely: Features | None = None) -> Peak:
    """Find the maximum of a response (n, n) to a fraction of a cell, by a parabola on each axis.

    With `likely` (n, n) it is that of the response times how likely each cell is.
    """
    n = response.shape[-1]
    i, j = divmod(int((response if likely is None else response * likely).argmax()), n)
    column = response[[i - 1, i, (i + 1) % n], j]
    row = response[i, [j - 1, j, (j + 1) % n]]
    return Peak(
        dx=j - n // 2 + _vertex(*row.tolist()),
        dy=i - n // 2 + _vertex(*column.tolist()),
        height=float(response[i, j]),
        psr=psr(response, i, j),
    )


def psr(response: Features, i: int, j: int, radius: int = 2) -> float:
    """Peak-to-sidelobe ratio of the maximum at [i, j]; the sidelobe leaves out 5 × 5 cells.

    >>> psr(label(18, 0.6), 9, 9) > 1000
    True
    """
    n = response.shape[-1]
    radius = min(radius, (n - 2) // 2)  # of a small response something has to be left
    around = np.ix_(*(np.arange(k - radius, k + radius + 1) % n for k in (i, j)))
    side = np.ones((n, n), bool)
    side[around] = False
    rest = response[side]
    return float((response[i, j] - rest.mean()) / (rest.std() + 1e-6))


def parabola(sizes: Features) -> Features:
    """Maps values at `sizes` (k,) to the coefficients of x² and x of the parabola nearest to them.

    >>> a, b = parabola(np.float32([-1, 0, 1])) @ [0, 1, 0]
    >>> round(float(-b / (2 * a)), 6), round(float(a), 6)
    (0.0, -1.0)
    """
    return np.linalg.pinv(np.vander(np.asarray(sizes, np.float64), 3))[:2].astype(np.float32)


def highest(heights: Features, sizes: Features, nearest: Features) -> float:
    """Size at which the parabola through the logarithms of `heights` (k,) has its top.

    In units of `sizes`, logarithms of what was looked at, and no further out than those;
    `nearest` is `parabola(sizes)`. Where there is no top between them, the highest of them; where
    nothing answers, 0.
    """
    level = np.log(np.maximum(heights, 1e-3))
    if np.ptp(level) < 1e-6:
        return 0.0
    bend, slope = (nearest @ level).tolist()
    top = -slope / (2 * bend) if bend < 0 else float(sizes[level.argmax()])
    return min(max(top, float(sizes[0])), float(sizes[-1]))


@cache
def _transform(n: int) -> tuple[Features, Spectrum]:
    """The Fourier matrices: of rows, as real (n, 2 (n // 2 + 1)); of columns, complex (n, n)."""
    turns = np.exp(-2j * np.pi / n * np.outer(np.arange(n), np.arange(n))).astype(np.complex64)
    return np.ascontiguousarray(turns[:, : n // 2 + 1]).view(np.float32), turns


def _vertex(before: float, at: float, after: float) -> float:
    """Where the parabola through three neighbours has its top, in [−½, ½] of the middle one."""
    curvature = before - 2 * at + after
    return 0.0 if curvature >= 0 else float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5))
