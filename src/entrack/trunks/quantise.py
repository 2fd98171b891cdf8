"""Int8 trunks: calibrate on real crops, compare with the float trunk, refuse what drifted.

The result is one ONNX file of QuantizeLinear/DequantizeLinear pairs, which OpenVINO and ONNX
Runtime both turn into int8 convolutions. Three choices matter more than the tool that makes it:

* The input has the range of pixels, so that it loses nothing.
* The range of every activation is the mean of what single crops need. The extremes over all crops
  come from a few odd cells and leave everything else a handful of steps.
* Weights keep 7 of their 8 bits. CPUs without VNNI add pairs of products in 16 bits, which overflow
  with 8-bit weights; with 7 the file says the same on every CPU, and loses next to nothing.
"""

import contextlib
import io
import logging
import os
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from entrack import filter as cf
from entrack.config import FilterConfig, WindowConfig
from entrack.errors import EntrackError, require
from entrack.files import unfinished
from entrack.trunk import ENGINES, Features, Trunk, load_trunk
from entrack.trunks import crops


@checked(frozen=True, config=ConfigDict(extra="forbid"))
class QuantiseConfig:
    """How much is looked at, and how far int8 may be from float."""

    calibration: int = Field(default=64, ge=1)
    """Crops from which the ranges of activations are taken."""
    check: int = Field(default=16, ge=2)
    """Crops, of other pictures, on which int8 is compared with float."""
    cosine: float = Field(default=0.985, ge=-1, le=1)
    """Least mean cosine between int8 and float features of a cell."""
    response: float = Field(default=0.997, ge=-1, le=1)
    """Least mean correlation between int8 and float responses of the filter."""
    seed: int = 0


@dataclass(frozen=True)
class Agreement:
    """How alike two trunks are."""

    cosine: float
    """Mean cosine between their features, cell by cell; cells that are all zero do not count."""
    response: float
    """Mean correlation between the responses of filters that are fitted to their features."""
    moved: float
    """Mean distance between the peaks of these responses, cells."""


def quantise(
    trunk: Path,
    pictures: Sequence[crops.Image],
    out: Path,
    config: QuantiseConfig | None = None,
) -> dict[str, Agreement]:
    """Write the int8 form of a float `trunk.onnx`; return how well it agrees on each engine.

    Every fourth picture is kept for the comparison, the others calibrate.

    Raises
    ------
    EntrackError
        If the trunk is quantised already, there are too few pictures, or the features drift
        further than `config` allows; then nothing is written.
    """
    config = config or QuantiseConfig()
    exact = load_trunk(trunk)
    if exact.precision == "int8":
        raise EntrackError(f"{trunk} is quantised already")
    held, used = pictures[::4], [p for i, p in enumerate(pictures) if i % 4]
    if not used:
        raise EntrackError("quantisation needs at least two pictures")
    size = WindowConfig().size
    rng = np.random.default_rng(config.seed)
    temporary = unfinished(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        _write_int8(trunk, crops.batch(used, config.calibration, size, rng), temporary)
        views = _views(held, config.check, size, rng)
        found = {e: agreement(exact, load_trunk(temporary, e), *views) for e in ENGINES}
        for engine, a in found.items():
            _refuse_drift(engine, a, config)
        os.replace(temporary, out)
    finally:
        temporary.unlink(missing_ok=True)
    return found


def agreement(
    one: Trunk, other: Trunk, templates: crops.Image, candidates: crops.Image
) -> Agreement:
    """Compare two trunks on templates and displaced candidates (N, S, S, 3)."""
    x, z = (np.concatenate([t(templates), t(candidates)]) for t in (one, other))
    norms = np.linalg.norm(x, axis=1) * np.linalg.norm(z, axis=1)
    cosines = (x * z).sum(axis=1)[norms > 0] / norms[norms > 0]
    mine, theirs = _responses(x), _responses(z)
    peaks = [[cf.peak(r) for r in responses] for responses in (mine, theirs)]
    moved = [np.hypot(a.dx - b.dx, a.dy - b.dy) for a, b in zip(*peaks, strict=True)]
    alike = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in zip(mine, theirs, strict=True)]
    return Agreement(float(cosines.mean()), float(np.mean(alike)), float(np.mean(moved)))


def _refuse_drift(engine: str, found: Agreement, config: QuantiseConfig) -> None:
    if found.cosine < config.cosine or found.response < config.response:
        raise EntrackError(
            f"int8 drifts too far from float on {engine}: features have a mean cosine of "
            f"{found.cosine:.4f} (least {config.cosine}), responses of the filter a correlation of "
            f"{found.response:.4f} (least {config.response})"
        )


def _write_int8(trunk: Path, patches: crops.Image, out: Path) -> None:
    """Calibrate ONNX Runtime's static quantisation on patches (N, S, S, 3), one at a time."""
    tool: Any = require("onnxruntime.quantization", "train")
    require("onnx", "train")

    class Reader(tool.CalibrationDataReader):
        def __init__(self) -> None:
            self.left = iter(patches)

        def get_next(self) -> dict[str, NDArray[np.float32]] | None:
            patch = next(self.left, None)
            if patch is None:
                return None
            return {"patch": np.ascontiguousarray(patch.transpose(2, 0, 1)[None], np.float32)}

    first, low, high = _pixel_range(trunk)
    with _quiet():
        tool.quantize_static(
            str(trunk),
            str(out),
            Reader(),
            quant_format=tool.QuantFormat.QDQ,
            per_channel=True,
            reduce_range=True,
            activation_type=tool.QuantType.QUInt8,
            weight_type=tool.QuantType.QInt8,
            calibrate_method=tool.CalibrationMethod.MinMax,
            extra_options={
                "CalibMovingAverage": True,
                "TensorQuantOverrides": {first: [{"rmin": low, "rmax": high}]},
            },
        )


def _pixel_range(trunk: Path) -> tuple[str, Features, Features]:
    """The tensor that the first convolution sees, and what black and white pixels become there."""
    onnx, ort = require("onnx", "train"), require("onnxruntime", "train")
    model = onnx.load(str(trunk))
    seen = next(node.input[0] for node in model.graph.node if node.op_type == "Conv")
    model.graph.output.append(onnx.ValueInfoProto(name=seen))
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    extremes = [
        session.run([seen], {"patch": np.full((1, 3, 32, 32), level, np.float32)})[0]
        for level in (0, 255)
    ]
    return seen, np.min(extremes, keepdims=True).ravel(), np.max(extremes, keepdims=True).ravel()


@contextlib.contextmanager
def _quiet() -> Generator[None, None, None]:
    """Swallow what the tool prints: it advises steps that a plain trunk does not need."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        logging.disable(before)


def _views(
    pictures: Sequence[crops.Image], count: int, size: int, rng: np.random.Generator
) -> tuple[crops.Image, crops.Image]:
    """Templates and the same scenes displaced by up to two cells, (N, size, size, 3) each."""
    reach = 32
    wide = crops.batch(pictures, count, size + 2 * reach, rng)
    places = rng.integers(0, 2 * reach + 1, (count, 2))
    displaced = [w[y : y + size, x : x + size] for w, (y, x) in zip(wide, places, strict=True)]
    return wide[:, reach:-reach, reach:-reach].copy(), np.stack(displaced)


def _responses(features: Features) -> Features:
    """Responses (N, n, n) of filters fitted to the first half of (2N, C, n, n), to the second."""
    cells = features.shape[-1]
    settings = FilterConfig()
    label = cf.label(cells, settings.label_sigma * cells / WindowConfig().context)
    templates, candidates = np.split(cf.spectrum(features * cf.hann(cells)), 2)
    weights = cf.fit(templates, cf.spectrum(label), settings.regularisation)
    return cf.respond(weights, candidates)
