"""The trunk: patch → features Z (second half of g, eq. 4), on OpenVINO or ONNX Runtime.

Both engines read the same `trunk.onnx`, which maps BGR pixels in [0, 255], float32 (N, 3, S, S), to
features float32 (N, C, S/16, S/16); and, if it has a second output, to what it saw on the way
there, in smaller cells.
"""

import hashlib
import os
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from entrack.errors import EntrackError, require

Image = NDArray[np.uint8]
Features = NDArray[np.float32]


class Trunk(Protocol):
    """Anything that turns patches into features."""

    precision: str
    """What it computes in on this machine, such as "int8" or "bf16"."""

    def __call__(self, patches: Image) -> Features:
        """Patches (N, S, S, 3) BGR uint8 → features (N, C, S/16, S/16) float32."""
        ...


class Maps(NamedTuple):
    """What a trunk sees in one patch."""

    z: Features
    """Z (C, S/16, S/16)."""
    fine: Features
    """What it saw before, in smaller cells (C', S/8, S/8): less of what a thing is, more of where.
    Z once more from a trunk that does not tell."""


def each(trunk: Trunk, patches: Iterable[Image]) -> Iterator[Maps]:
    """Yield what the trunk sees in each patch (S, S, 3), in their order.

    A trunk with a method `each` does it as the patches come; to others they are one batch.
    """
    own = getattr(trunk, "each", None)
    if own:
        yield from own(patches)
    else:
        yield from (Maps(z, z) for z in trunk(np.stack(list(patches))))


class OpenVINOTrunk:
    """The default engine: networks for one patch, and several patches at a time.

    Each runs on a thread of its own, which is as fast as a batch on idle cores and much faster on
    busy ones. One that is left alone, as the last of an odd number is, has all threads.
    """

    def __init__(self, path: Path, threads: int | None = None, exact: bool = False) -> None:
        import openvino as ov

        self._ov = ov
        self._core = ov.Core()
        self._path = path
        self._source: Any = _exact(path) if exact else path
        threads = threads or os.cpu_count() or 1
        self._options: dict[str, Any] = {
            "INFERENCE_NUM_THREADS": threads,
            "ENABLE_CPU_PINNING": False,
        }
        self._streams = min(threads, 4)
        self._size = 0
        self._networks: dict[int, Any] = {}
        self._requests: dict[tuple[int, int], Any] = {}
        capabilities = self._core.get_property("CPU", "OPTIMIZATION_CAPABILITIES")
        quantised = b"QuantizeLinear" in path.read_bytes()
        self.precision = "fp32" if exact else _precision(quantised, capabilities)
        if exact:
            self._options["INFERENCE_PRECISION_HINT"] = "f32"

    def __call__(self, patches: Image) -> Features:
        """See `Trunk`."""
        return np.stack([maps.z for maps in self.each(patches)])

    def each(self, patches: Iterable[Image]) -> Iterator[Maps]:
        """See `each`: it works on patches while the caller cuts the next, or uses the last."""
        running: list[_Run] = []
        patches = iter(patches)
        patch = next(patches, None)
        try:
            while patch is not None:
                following = next(patches, None)
                alone = following is None and len(running) % self._streams == 0
                if alone:
                    for run in running:
                        run.request.wait()
                running.append(self._start(patch, len(running), 1 if alone else self._streams))
                patch = following
            for run in running:
                run.request.wait()
                yield Maps(run.maps[0][0], run.maps[-1][0])
        finally:
            for run in running:
                run.request.wait()

    def _start(self, patch: Image, index: int, streams: int) -> "_Run":
        """Begin with the patch at `index`, on one of so many streams."""
        if len(patch) != self._size:
            self._networks, self._requests, self._size = {}, {}, len(patch)
        if streams not in self._networks:
            self._networks[streams] = self._compile(self._size, streams)
        network, place = self._networks[streams], (streams, index)
        if place not in self._requests:
            self._requests[place] = network.create_infer_request()
        patch = np.ascontiguousarray(patch[None])
        maps = [np.empty(output.shape, np.float32) for output in network.outputs]
        run = _Run(self._requests[place], patch, maps)
        run.request.set_input_tensor(self._ov.Tensor(run.patch, shared_memory=True))
        for index, found in enumerate(maps):
            run.request.set_output_tensor(index, self._ov.Tensor(found, shared_memory=True))
        run.request.start_async()
        return run

    def _compile(self, size: int, streams: int) -> Any:
        ov = self._ov
        try:
            model = self._core.read_model(self._source)
            model.reshape([1, 3, size, size])
            steps = ov.preprocess.PrePostProcessor(model)
            steps.input().tensor().set_element_type(ov.Type.u8).set_layout(ov.Layout("NHWC"))
            steps.input().model().set_layout(ov.Layout("NCHW"))
            options = self._options | {"NUM_STREAMS": streams}
            network = self._core.compile_model(steps.build(), "CPU", options)
            shape = list(network.output(0).shape)
        except RuntimeError as error:
            why = str(error).strip().splitlines()[-1]
            raise EntrackError(f"{self._path} is no trunk: {why}") from error
        if len(shape) != 4 or shape[2:] != [size // 16, size // 16]:
            cells = f"(1, C, {size // 16}, {size // 16})"
            raise EntrackError(f"{self._path} is no trunk: it makes {shape}, expected {cells}")
        return network


class _Run(NamedTuple):
    """A patch that is worked on; the engine reads and writes the memory of all arrays."""

    request: Any
    patch: Image
    maps: list[Features]


class OnnxRuntimeTrunk:
    """The engine of the `gpu` extra: on CUDA where that works, otherwise on the CPU."""

    def __init__(
        self, path: Path, threads: int | None = None, device: str = "cpu", exact: bool = False
    ) -> None:
        ort = require("onnxruntime", "gpu")
        options = ort.SessionOptions()
        if threads:
            options.intra_op_num_threads = threads
        there = ort.get_available_providers()
        wanted = [p for p in _PROVIDERS[device] if p in there]
        content = _exact(path) if exact else for_onnxruntime(path)
        self._session = ort.InferenceSession(content, options, providers=wanted)
        # CUDA may be in the package and yet not start, without a driver or its libraries.
        if self._session.get_providers()[0] != _PROVIDERS[device][0]:
            warnings.warn(
                f"ONNX Runtime cannot use {device} here, so the trunk runs on the CPU; it takes a "
                "driver, and the package onnxruntime-gpu in place of onnxruntime",
                stacklevel=2,
            )
        self._input = self._session.get_inputs()[0].name
        self.precision = "int8 and fp32" if b"QuantizeLinear" in content else "fp32"

    def __call__(self, patches: Image) -> Features:
        """See `Trunk`."""
        return self._run(patches)[0]

    def each(self, patches: Iterable[Image]) -> Iterator[Maps]:
        """See `each`: one batch."""
        found = self._run(np.stack(list(patches)))
        yield from map(Maps, found[0], found[-1])

    def _run(self, patches: Image) -> list[Features]:
        x = np.ascontiguousarray(patches.transpose(0, 3, 1, 2), np.float32)
        return self._session.run(None, {self._input: x})


def for_onnxruntime(path: Path) -> bytes:
    """The network; a quantised one without the rounding of convolutions that are added to.

    OpenVINO adds first and rounds once. ONNX Runtime would round twice, and its tracker would be
    another one; like this it computes such convolutions in fp32.
    """
    content = path.read_bytes()
    if b"QuantizeLinear" not in content:
        return content
    onnx = require("onnx", "gpu")
    model = onnx.load(str(path))
    graph = model.graph
    makers = {name: node for node in graph.node for name in node.output}
    constants = {c.name: c for c in graph.initializer}
    for total in [node for node in graph.node if node.op_type == "Add"]:
        restore = makers[total.input[0]]  # the convolution; the shortcut comes second
        if restore.op_type != "DequantizeLinear" or restore.input[0] not in makers:
            continue
        rounding = makers[restore.input[0]]
        if sum(restore.output[0] in node.input for node in graph.node) > 1:
            continue  # the shortcut came first, and the convolution is made of it
        # A range that begins at zero is a ReLU, too, and has to stay.
        if onnx.numpy_helper.to_array(constants[rounding.input[2]]) > 0:
            total.input[0] = rounding.input[0]
            graph.node.remove(restore)
            graph.node.remove(rounding)
    used = {name for node in graph.node for name in node.input}
    for constant in [c for c in graph.initializer if c.name not in used]:
        graph.initializer.remove(constant)
    return model.SerializeToString()


_PROVIDERS = {
    "cpu": ["CPUExecutionProvider"],
    "cuda": ["CUDAExecutionProvider", "CPUExecutionProvider"],
}
PRECISIONS = ("model", "fp32")
ENGINES = {"openvino": OpenVINOTrunk, "onnxruntime": OnnxRuntimeTrunk}


def load_trunk(
    path: Path,
    engine: str = "openvino",
    threads: int | None = None,
    device: str = "cpu",
    precision: str = "model",
) -> Trunk:
    """Open a `trunk.onnx` on "openvino" or "onnxruntime"; `threads` None lets it choose.

    `device` "cuda" is for "onnxruntime" alone, and falls back to the CPU with one warning. With
    `precision` "fp32" a quantised trunk is computed in float, and none in bf16.
    """
    if not path.is_file():
        raise EntrackError(f"no trunk {path}")
    if engine not in ENGINES:
        raise EntrackError(f"no engine {engine!r}: there are {', '.join(ENGINES)}")
    if precision not in PRECISIONS:
        raise EntrackError(f"no precision {precision!r}: there are {', '.join(PRECISIONS)}")
    if threads is not None and threads < 1:
        raise EntrackError(f"threads must be at least 1, found {threads}")
    if device not in _PROVIDERS:
        raise EntrackError(f"no device {device!r}: there are {', '.join(_PROVIDERS)}")
    if b"\n\x08location" in path.read_bytes():  # a key of ONNX's `external_data`
        raise EntrackError(f"{path} has its weights in another file, which no checksum covers")
    if engine == "onnxruntime":
        return OnnxRuntimeTrunk(path, threads, device, precision == "fp32")
    if device != "cpu":
        raise EntrackError(
            f'{engine} runs on the CPU: device "{device}" takes engine="onnxruntime"'
        )
    return OpenVINOTrunk(path, threads, precision == "fp32")


def sha256(path: Path) -> str:
    """The checksum by which a model folder names its files."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _exact(path: Path) -> bytes:
    from entrack.trunks.dequantise import dequantise

    return dequantise(path)


def _precision(quantised: bool, capabilities: list[str]) -> str:
    if quantised:
        return "int8" if "INT8" in capabilities else "fp32"
    return "bf16" if "BF16" in capabilities else "fp32"
