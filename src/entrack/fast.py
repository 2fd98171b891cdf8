"""The conditioned f1 as a network of OpenVINO, compiled when it is first used.

In numpy its convolutions wake the threads of BLAS. They go on spinning for milliseconds after each
product, on the very cores that the trunk wants: a frame of `policy` cost 29 ms of CPU time instead
of 13. `entrack.state.Conditioned` is the reference; both say the same to 1e-4.
"""

from typing import Any, cast

import numpy as np
import openvino as ov
from openvino import opset13 as ops

from entrack.state import GRID, Array, Conditioned, context


class CompiledConditioned(Conditioned):
    """`Conditioned`, with the same weights, on `threads` threads of OpenVINO."""

    def __init__(self, reference: Conditioned, threads: int = 1) -> None:
        self.w, self.layers, self.threads = reference.w, reference.layers, threads
        self._networks: dict[tuple[int, ...], Any] = {}

    def __call__(self, features: Array, response: Array, held: Array, target: object) -> Array:
        """See `F1`."""
        if features.shape not in self._networks:
            self._networks[features.shape] = self._compile(*features.shape[:2])
        keys, gate = cast(tuple[Array, Array], target)
        inputs = (features, context(response, held), keys, gate)
        # The network reads their memory, so they live until it is through.
        arrays = [np.ascontiguousarray(value, np.float32) for value in inputs]
        request = self._networks[features.shape]
        for i, array in enumerate(arrays):
            request.set_input_tensor(i, ov.Tensor(array, shared_memory=True))
        request.infer()
        return request.get_output_tensor().data.copy()

    def _compile(self, channels: int, n: int) -> Any:
        """The network for features (channels, n, n), ready to run."""
        w, cells = self.w, n * n
        parts = ("match", "belong", "itself")
        sizes = [len(w[f"{part}.bias"]) for part in parts]
        shapes = [(channels, n, n), (8, cells), (sizes[0], GRID * GRID), (sizes[1],)]
        inputs = [ops.parameter(shape, np.float32) for shape in shapes]
        features, planes, keys, gate = inputs
        flat = ops.reshape(features, np.array([channels, cells]), False)
        weight, bias = (np.concatenate([w[f"{p}.{kind}"] for p in parts]) for kind in _KINDS)
        projected = ops.add(ops.matmul(weight, flat, False, False), bias[:, None])
        match, belong, itself = ops.variadic_split(projected, 0, np.array(sizes)).outputs()
        unit = ops.normalize_l2(match, np.array([0]), 1e-24, "max")
        likeness = ops.multiply(ops.matmul(keys, unit, True, False), np.float32(4))
        gated = ops.multiply(ops.relu(belong), ops.unsqueeze(gate, np.array(1)))
        seen = ops.concat([likeness, gated, itself, planes], 0)
        mixed = ops.matmul(w["mix.weight"], seen, False, False)
        x = ops.relu(ops.add(mixed, w["mix.bias"][:, None]))
        x = ops.reshape(x, np.array([1, -1, n, n]), False)
        for k in range(self.layers):
            weight, bias = (w[f"convs.{k}.{kind}"] for kind in _KINDS)
            kernel = weight.reshape(len(weight), 3, 3, -1).transpose(0, 3, 1, 2).copy()
            y = ops.convolution(x, kernel, [1, 1], [1, 1], [1, 1], [1, 1])
            x = ops.add(x, ops.relu(ops.add(y, bias[:, None, None])))
        z = ops.squeeze(x, np.array([0]))
        options = {
            "NUM_STREAMS": 1,
            "INFERENCE_NUM_THREADS": self.threads,
            "ENABLE_CPU_PINNING": False,
            "INFERENCE_PRECISION_HINT": "f32",
        }
        model: Any = ov.Model([z], inputs, "f1")  # pyright: ignore[reportGeneralTypeIssues]
        return ov.Core().compile_model(model, "CPU", options).create_infer_request()


_KINDS = ("weight", "bias")
