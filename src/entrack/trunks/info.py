"""What a trunk is made of and what it costs; needs no more than the base install."""

import math
import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from entrack.bench import engines, summary
from entrack.config import read_toml
from entrack.errors import EntrackError
from entrack.model import load_model
from entrack.trunk import sha256


@dataclass(frozen=True)
class TrunkInfo:
    """Everything that `entrack trunk info` prints."""

    path: str
    sha256: str
    bytes: int
    model: str | None
    """Name of the model that it belongs to, if one was asked for …"""
    provenance: str | None
    """… and what that model says of itself."""
    card: str | None
    """A model card beside the trunk."""
    size: int
    """Side of the patch that the numbers below are for, pixels."""
    parameters: int
    """Weights and biases of the convolutions."""
    gmac: float
    """Billions of multiplications and additions for one patch."""
    convolutions: dict[str, int]
    """How many convolutions OpenVINO runs in each precision on this machine."""
    threads: int
    ms: dict[str, dict[str, float]]
    """Median milliseconds of a patch on each engine: `alone`, and as one of `four`."""


def inspect(place: str | Path, threads: int | None = None, size: int = 288) -> TrunkInfo:
    """Look into a `trunk.onnx`, or into the trunk of a model by name or folder.

    Raises
    ------
    EntrackError
        If there is no such model, or the file is not a trunk.
    """
    model = description = None
    path = Path(place)
    if path.suffix != ".onnx":
        opened = load_model(place)
        path, model, size = opened.trunk, opened.name, opened.config.window.size
        description = read_toml(opened.folder / "model.toml")["description"]
    elif not path.is_file():
        raise EntrackError(f"no trunk {path}")
    path = path.resolve()
    threads = threads or os.cpu_count() or 1
    network, runtime = _open(path, size, threads)
    parameters, macs = _count(network)
    times = engines(path, threads, size)
    card = path.with_name("MODEL_CARD.md")
    return TrunkInfo(
        path=str(path),
        sha256=sha256(path),
        bytes=path.stat().st_size,
        model=model,
        provenance=description,
        card=str(card) if card.is_file() else None,
        size=size,
        parameters=parameters,
        gmac=macs / 1e9,
        convolutions=_precisions(runtime),
        threads=threads,
        ms={
            engine: {"alone": summary(t["1"])["ms"], "four": summary(t["4"])["ms"] / 4}
            for engine, t in times.items()
        },
    )


def _open(path: Path, size: int, threads: int) -> tuple[Any, Any]:
    """The network for one patch, as it is written and as OpenVINO runs it."""
    import openvino as ov

    core = ov.Core()
    try:
        network = core.read_model(path)
        network.reshape([1, 3, size, size])
        compiled = core.compile_model(network, "CPU", {"INFERENCE_NUM_THREADS": threads})
    except RuntimeError as error:
        raise EntrackError(f"{path} is not a trunk that OpenVINO can run") from error
    return network, compiled.get_runtime_model()


def _count(network: Any) -> tuple[int, int]:
    """Parameters, and multiplications with additions, of all convolutions."""
    parameters = macs = 0
    for op in network.get_ordered_ops():
        kind = op.get_type_name()
        if kind in ("Convolution", "GroupConvolution"):
            weights = list(op.input(1).get_shape())
            output = list(op.output(0).get_shape())
            parameters += math.prod(weights) + output[1]
            # (out, in, h, w), or (groups, out, in, h, w): each output sums over the last three.
            macs += math.prod(output) * math.prod(weights[-3:])
    return parameters, macs


def _precisions(runtime: Any) -> dict[str, int]:
    """Count the executed convolutions by precision."""
    names = {"i8": "int8", "u8": "int8", "f32": "fp32", "f16": "fp16"}
    found: Counter[str] = Counter()
    for op in runtime.get_ordered_ops():
        facts = op.get_rt_info()
        if facts["layerType"].astype(str) in ("Convolution", "GroupConvolution"):
            precision = str(facts["runtimePrecision"].astype(str)).lower()
            found[names.get(precision, precision)] += 1
    return dict(found)
