"""Trunks as ONNX files: what the tracker runs."""

import os
import warnings
from pathlib import Path
from typing import cast

import torch
from torch import Tensor, nn

from entrack.trunks.networks import Student, fold_all, fold_input


def export(network: nn.Module, path: Path) -> None:
    """Write a network (N, 3, H, W) → (N, 256, H/16, W/16) as ONNX; N, H and W stay free.

    A student has a second output `fine` (N, C', H/8, W/8), see `entrack.trunk.Maps`.
    """
    network, outputs = network.eval(), ["features"]
    if isinstance(network, Student):
        network = _Telling(fold_input(cast(Student, fold_all(network))))
        outputs.append("fine")
    free = {name: {0: "n", 2: f"{name}_h", 3: f"{name}_w"} for name in ("patch", *outputs)}
    temporary = path.with_suffix(".tmp")
    network.to(memory_format=torch.contiguous_format)  # pyright: ignore[reportCallIssue]
    with warnings.catch_warnings():
        # The newer exporter needs onnxscript, and brings nothing for a plain chain of convolutions.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            network,
            (torch.zeros(1, 3, 288, 288),),
            str(temporary),
            input_names=["patch"],
            output_names=outputs,
            dynamic_axes=free,
            opset_version=17,
            dynamo=False,
        )
    os.replace(temporary, path)


class _Telling(nn.Module):
    """A student that returns both maps."""

    def __init__(self, student: Student) -> None:
        super().__init__()
        self.student = student

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        return self.student.maps(x)
