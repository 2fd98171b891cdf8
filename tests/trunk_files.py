"""Small trunks and pictures for tests."""

from pathlib import Path

import cv2
import numpy as np
import torch
from torch import nn

from entrack.trunks.export import export
from entrack.trunks.networks import Student, StudentConfig

SMALL = StudentConfig(stem=(8, 16), widths=(16, 24, 32), depths=(1, 1, 1))


def student(config: StudentConfig = SMALL, seed: int = 0) -> Student:
    """A student of random weights, whose batch norms have statistics that matter."""
    torch.manual_seed(seed)
    network = Student(config).eval()
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean, -0.3, 0.3)
            nn.init.uniform_(module.running_var, 0.5, 2.0)
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.uniform_(module.bias, -0.3, 0.3)
    return network


def write_trunk(path: Path, config: StudentConfig = SMALL, seed: int = 0) -> Path:
    """A `trunk.onnx` of such a student."""
    export(student(config, seed), path)
    return path


def picture(seed: int, height: int = 200, width: int = 240) -> np.ndarray:
    """Blobs of colour at several scales, BGR uint8."""
    rng = np.random.default_rng(seed)
    layers = []
    for cells in (3, 8, 24):
        coarse = rng.uniform(0, 255, (cells, cells, 3)).astype(np.float32)
        layers.append(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC))
    return np.clip(np.mean(layers, axis=0), 0, 255).astype(np.uint8)
