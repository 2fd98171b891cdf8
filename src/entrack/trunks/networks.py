"""Trunk networks in torch: the paper's ResNet-18 to layer3, and the small students that we ship.

All of them map BGR pixels in [0, 255], float32 (N, 3, H, W), to features (N, 256, H/16, W/16); a
student tells what it saw at stride 8, too.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass
from torch import Tensor, nn

CHANNELS = 256
MEAN_RGB, STD_RGB = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # torchvision's, of ImageNet


def as_input(patches: NDArray[np.uint8]) -> Tensor:
    """Patches (N, S, S, 3) uint8 → (N, 3, S, S) float32, channels last in memory."""
    return torch.from_numpy(patches).permute(0, 3, 1, 2).float()


def sound_kernels(network: nn.Module) -> AbstractContextManager[None]:
    """Train a network in this: oneDNN computes it, unless it is narrow.

    With 8 channels, the kernels of torch 2.13 for AVX-512 write past their arrays on some
    processors, and the process is aborted.
    """
    convs = [m for m in network.modules() if isinstance(m, nn.Conv2d)]
    wide = all(m.out_channels % 16 == 0 for m in convs)
    return nullcontext() if wide else torch.backends.mkldnn.flags(enabled=False)


class Normalise(nn.Module):
    """BGR in [0, 255] → RGB with ImageNet's mean and standard deviation."""

    def __init__(self) -> None:
        super().__init__()
        for name, rgb in ("mean", MEAN_RGB), ("std", STD_RGB):
            bgr = torch.tensor(rgb[::-1]).mul(255).reshape(1, 3, 1, 1)
            self.register_buffer(name, bgr, persistent=False)
        self.mean: Tensor
        self.std: Tensor

    def forward(self, x: Tensor) -> Tensor:
        return ((x - self.mean) / self.std).flip(1)


def conv(inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1) -> nn.Sequential:
    """Convolution and batch norm, as one unit that `fold` can make one convolution of."""
    layer = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(outputs))


class Basic(nn.Module):
    """ResNet's basic block: two 3×3 convolutions and a shortcut."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = conv(inputs, outputs, 3, stride)
        self.conv2 = conv(outputs, outputs, 3)
        same = inputs == outputs and stride == 1
        self.shortcut = nn.Identity() if same else conv(inputs, outputs, 1, stride)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(self.conv2(torch.relu(self.conv1(x))) + self.shortcut(x))


class Rep(nn.Module):
    """RepVGG's block: 3×3 + 1×1 + identity while training, one 3×3 convolution afterwards."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv3 = conv(inputs, outputs, 3, stride)
        self.conv1 = conv(inputs, outputs, 1, stride)
        same = inputs == outputs and stride == 1
        self.identity = nn.BatchNorm2d(outputs) if same else None

    def forward(self, x: Tensor) -> Tensor:
        y = self.conv3(x) + self.conv1(x)
        return torch.relu(y if self.identity is None else y + self.identity(x))

    def folded(self) -> nn.Module:
        """Add up the three branches: each is a 3×3 convolution in disguise."""
        total = fold(self.conv3)
        one = fold(self.conv1)
        with torch.no_grad():
            total.weight[:, :, 1:2, 1:2] += one.weight
            total.bias += one.bias  # pyright: ignore[reportOperatorIssue]
            if self.identity is not None:
                scale, shift = _affine(self.identity)
                total.weight[:, :, 1, 1] += torch.diag(scale)
                total.bias += shift  # pyright: ignore[reportOperatorIssue]
        return nn.Sequential(total, nn.ReLU())


class Separable(nn.Module):
    """MobileNetV2's block: 1×1 to twice the width, depthwise 3×3, 1×1 back, and a shortcut."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        wide = 2 * inputs
        self.expand = conv(inputs, wide, 1)
        self.depthwise = conv(wide, wide, 3, stride, groups=wide)
        self.project = conv(wide, outputs, 1)
        self.same = inputs == outputs and stride == 1

    def forward(self, x: Tensor) -> Tensor:
        y = self.project(torch.relu(self.depthwise(torch.relu(self.expand(x)))))
        return x + y if self.same else y


BLOCKS = {"basic": Basic, "rep": Rep, "separable": Separable}


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class StudentConfig:
    """The shape of a student trunk."""

    stem: tuple[int, ...] = (16, 32)
    """Channels of the 3×3 stride-2 convolutions that bring 288² to 72²."""
    widths: tuple[int, int, int] = (32, 64, 128)
    """Channels of the three stages, at strides 4, 8 and 16."""
    depths: tuple[int, int, int] = (2, 2, 2)
    """Blocks of each stage."""
    block: Literal["basic", "rep", "separable"] = "basic"
    """What a stage is made of."""


class Student(nn.Module):
    """A small residual network with the paper's output shape."""

    def __init__(self, config: StudentConfig) -> None:
        super().__init__()
        self.normalise = Normalise()
        layers: list[nn.Module] = []
        channels = 3
        for width in config.stem:
            layers += [conv(channels, width, 3, 2), nn.ReLU()]
            channels = width
        for stage, (width, depth) in enumerate(zip(config.widths, config.depths, strict=True)):
            for i in range(depth):
                stride = 2 if stage > 0 and i == 0 else 1
                layers.append(BLOCKS[config.block](channels, width, stride))
                channels = width
        self.body = nn.Sequential(*layers)
        self.last = config.depths[-1]
        self.head = conv(channels, CHANNELS, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.maps(x)[0]

    def maps(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Features, and the map at stride 8 that the last stage makes them of."""
        fine = self.body[: -self.last](self.normalise(x))
        return torch.relu(self.head(self.body[-self.last :](fine))), fine


class ResNet18(nn.Module):
    """The paper's trunk: ResNet-18, conv1 … layer3, with batch norm folded into the weights."""

    def __init__(self) -> None:
        super().__init__()
        self.normalise = Normalise()
        self.conv1 = nn.Conv2d(3, 64, 7, 2, 3)
        self.pool = nn.MaxPool2d(3, 2, 1)
        self.layer1 = nn.Sequential(_Folded(64, 64, 1), _Folded(64, 64, 1))
        self.layer2 = nn.Sequential(_Folded(64, 128, 2), _Folded(128, 128, 1))
        self.layer3 = nn.Sequential(_Folded(128, 256, 2), _Folded(256, 256, 1))

    def forward(self, x: Tensor) -> Tensor:
        x = self.pool(torch.relu(self.conv1(self.normalise(x))))
        return self.layer3(self.layer2(self.layer1(x)))

    def load_folded(self, weights: Mapping[str, NDArray[np.float32]]) -> "ResNet18":
        """Take weights by torchvision's names; what a name lacks or has too much is an error."""
        self.load_state_dict({k: torch.from_numpy(np.asarray(v)) for k, v in weights.items()})
        return self


class _Folded(nn.Module):
    """torchvision's basic block after folding, so that its parameter names fit."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1)
        same = inputs == outputs and stride == 1
        self.downsample = None if same else nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride))

    def forward(self, x: Tensor) -> Tensor:
        shortcut = x if self.downsample is None else self.downsample(x)
        return torch.relu(self.conv2(torch.relu(self.conv1(x))) + shortcut)


def _affine(norm: nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
    """Batch norm in inference as (scale, shift)."""
    assert norm.running_var is not None and norm.running_mean is not None
    scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
    return scale, norm.bias - norm.running_mean * scale


def fold(unit: nn.Sequential) -> nn.Conv2d:
    """One convolution that equals convolution and batch norm in inference."""
    old, norm = unit[0], unit[1]
    assert isinstance(old, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)
    scale, shift = _affine(norm)
    new = nn.Conv2d(
        old.in_channels,
        old.out_channels,
        old.kernel_size,  # pyright: ignore[reportArgumentType]
        old.stride,  # pyright: ignore[reportArgumentType]
        old.padding,  # pyright: ignore[reportArgumentType]
        groups=old.groups,
    )
    with torch.no_grad():
        new.weight.copy_(old.weight * scale.reshape(-1, 1, 1, 1))
        new.bias.copy_(shift)  # pyright: ignore[reportOptionalMemberAccess]
    return new


def fold_all(module: nn.Module) -> nn.Module:
    """Fold every `conv` unit and every `Rep` block below `module`, in place, for export."""
    for name, child in module.named_children():
        if isinstance(child, Rep):
            setattr(module, name, child.folded())
        elif (
            isinstance(child, nn.Sequential)
            and len(child) == 2
            and isinstance(child[1], nn.BatchNorm2d)
        ):
            setattr(module, name, fold(child))
        else:
            fold_all(child)
    return module


class Centre(nn.Module):
    """Pixels about zero, so that the zero padding of a convolution is the colour grey."""

    GREY = 115.0

    def forward(self, x: Tensor) -> Tensor:
        return x - self.GREY


def fold_input(student: Student) -> Student:
    """Put the normalisation into the first convolution, in place; its padding becomes grey.

    Features change a little, at the border only, where the padding was ImageNet's mean colour.
    """
    normalise, first = student.normalise, student.body[0]
    assert isinstance(normalise, Normalise) and isinstance(first, nn.Conv2d)
    assert first.bias is not None
    with torch.no_grad():
        weight = first.weight.flip(1) / normalise.std
        first.bias += (weight * (Centre.GREY - normalise.mean)).sum((1, 2, 3))
        first.weight.copy_(weight)
    student.normalise = Centre()  # pyright: ignore[reportAttributeAccessIssue]
    return student
