"""Trunks as ONNX files: what the tracker runs."""

import os
import warnings
from pathlib import Path
from typing import cast

import torch
from torch import nn

from entrack.trunks.networks import Student, fold_all, fold_input


def export(network: nn.Module, path: Path) -> None:
    """Write a network (N, 3, H, W) → (N, 256, H/16, W/16) as ONNX; N, H and W stay free."""
    network = network.eval()
    if isinstance(network, Student):
        network = fold_input(cast(Student, fold_all(network)))
    free = {0: "n", 2: "h", 3: "w"}
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
            output_names=["features"],
            dynamic_axes={"patch": free, "features": free},
            opset_version=17,
            dynamo=False,
        )
    os.replace(temporary, path)
