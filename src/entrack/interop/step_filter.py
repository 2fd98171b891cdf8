"""`entrack.filter` in torch, for `entrack.interop.step`: by the same names, on the same numbers.

Transforms of 18 × 18 maps are matrix products, so the graph has no FFT.
"""
# pyright: basic

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from entrack import filter as cf
from entrack.config import Config


class Filtering(nn.Module):
    """What a step does with the filter: eqs. 1–3, the peak, and the size that answers most."""

    taper: Tensor
    label_re: Tensor
    label_im: Tensor
    rows_re: Tensor
    rows_im: Tensor
    columns_re: Tensor
    columns_im: Tensor
    back_re: Tensor
    back_im: Tensor
    zooms: Tensor
    penalties: Tensor
    sizes: Tensor
    parabola: Tensor

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.config, self.n = config, config.window.size // 16
        n = self.n
        taper = cf.hann(n) if config.filter.hann else np.ones((n, n), np.float32)
        label = cf.spectrum(cf.label(n, config.filter.label_sigma * n / config.window.context))
        turns: Any = np.exp(-2j * np.pi / n * np.outer(np.arange(n), np.arange(n)))
        once = np.where(np.arange(n // 2 + 1) % (n / 2) == 0, 1, 2)  # irfft counts the rest twice
        back = turns[: n // 2 + 1].conj() * once[:, None] / n**2
        half = config.scale.steps // 2
        steps = np.arange(-half, half + 1)
        zooms = config.scale.factor ** steps.astype(np.float64)
        sizes = np.log(zooms.astype(np.float32))
        arrays = {
            "taper": taper, "label_re": label.real, "label_im": label.imag,
            "rows_re": turns.real[:, : n // 2 + 1], "rows_im": turns.imag[:, : n // 2 + 1],
            "columns_re": turns.real, "columns_im": turns.imag,
            "back_re": back.real, "back_im": back.imag,
            "zooms": zooms, "penalties": config.scale.penalty ** np.abs(steps),
            "sizes": sizes, "parabola": cf.parabola(sizes),
        }  # fmt: skip
        for name, array in arrays.items():
            self.register_buffer(name, torch.from_numpy(np.array(array, np.float32)))

    def spectrum(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Real and imaginary part of the 2D Fourier transform."""
        re, im = x @ self.rows_re, x @ self.rows_im
        return (
            self.columns_re @ re - self.columns_im @ im,
            self.columns_re @ im + self.columns_im @ re,
        )

    def respond(self, template: Tensor, z: Tensor) -> Tensor:
        """M (k, n, n): eqs. 1–3 at once; the label and the energy are the same for all channels."""
        (x_re, x_im), (z_re, z_im) = self.spectrum(template), self.spectrum(z)
        energy = (x_re**2 + x_im**2).sum(0)
        energy = energy + self.config.filter.regularisation * energy.mean() + 1.2e-38
        re, im = (x_re * z_re + x_im * z_im).sum(1), (x_re * z_im - x_im * z_re).sum(1)
        y_re, y_im = self.label_re / energy, self.label_im / energy
        re, im = re * y_re - im * y_im, re * y_im + im * y_re
        along = (
            self.columns_re @ re + self.columns_im @ im,
            self.columns_re @ im - self.columns_im @ re,
        )
        return along[0] @ self.back_re - along[1] @ self.back_im

    def highest(self, heights: Tensor) -> Tensor:
        """`filter.highest`: (1,)."""
        level = heights.clamp_min(1e-3).log()
        bend, slope = self.parabola @ level
        top = -slope / (2 * torch.where(bend < 0, bend, -1.0))
        top = torch.where(bend < 0, top, self.sizes[level.argmax()])
        top = torch.where(level.amax() - level.amin() < 1e-6, 0.0, top)
        return top.clamp(self.sizes[0], self.sizes[-1])[None]

    def peak(self, response: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """`filter.peak`: dx, dy in cells, height, peak-to-sidelobe ratio."""
        n, flat = self.n, response.flatten()
        at = flat.argmax(0)
        i, j = torch.div(at, n, rounding_mode="floor"), at % n

        def around(down: int, right: int) -> Tensor:
            return flat[((i + down + n) % n) * n + (j + right + n) % n]

        def vertex(before: Tensor, after: Tensor) -> Tensor:
            bend = before - 2 * flat[at] + after
            top = (0.5 * (before - after) / torch.where(bend < 0, bend, -1.0)).clamp(-0.5, 0.5)
            return torch.where(bend < 0, top, 0.0)

        k = torch.arange(n)
        near = [((k - c + n + n // 2) % n - n // 2).abs() <= 2 for c in (i, j)]
        side = 1 - (near[0][:, None] & near[1][None]).float()
        mean = (response * side).sum() / side.sum()
        deviation = ((((response - mean) * side) ** 2).sum() / side.sum()).sqrt()
        dx = j - n // 2 + vertex(around(0, -1), around(0, 1))
        dy = i - n // 2 + vertex(around(-1, 0), around(1, 0))
        return dx, dy, flat[at], (flat[at] - mean) / (deviation + 1e-6)
