"""ResNet-18 from elsewhere, as the trunk of the `paper` model: exactly conv1 … layer3."""

import pickle
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load_file  # pyright: ignore[reportUnknownVariableType]

from entrack.config import Config, read
from entrack.errors import EntrackError
from entrack.model import assets, save_model
from entrack.trunk import sha256
from entrack.trunks.export import export
from entrack.trunks.networks import ResNet18

Weights = Mapping[str, NDArray[np.float64]]
EPSILON = 1e-5  # of batch norm, in torchvision and in timm


def import_trunk(file: Path, out: Path) -> Path:
    """Make a model folder of ResNet-18's weights; return its `trunk.onnx`.

    Parameters
    ----------
    file
        torchvision's `.pth` or `.safetensors`, timm's `.safetensors`, or an `.npz` whose batch norm
        is folded; all of them use torchvision's names.
    out
        Becomes a folder that `entrack track --model` takes, with the `paper` preset.

    Raises
    ------
    EntrackError
        If the file is no such file, or `out` holds a model already.
    """
    if (out / "model.toml").exists():
        raise EntrackError(f"{out} holds a model already: name a new folder")
    network = read_resnet18(file)
    out.mkdir(parents=True, exist_ok=True)
    export(network, out / "trunk.onnx")
    origin = f"ResNet-18 to layer3, imported from {file.name} (SHA-256 {sha256(file)})"
    config = read(Config, assets().parent / "presets" / "paper.toml")
    save_model(
        out, "paper", f"{origin}; the filter as the paper has it.", config, out / "trunk.onnx"
    )
    return out / "trunk.onnx"


def read_resnet18(file: Path) -> ResNet18:
    """ResNet-18 to layer3 with the weights of a file, ready for inference; see `import_trunk`."""
    network = ResNet18().load_folded(folded(read_weights(file), str(file)))
    return network.eval().requires_grad_(False)


def read_weights(file: Path) -> Weights:
    """Read a file of named tensors; nothing in it is executed."""
    if not file.is_file():
        raise EntrackError(f"no weights {file}")
    if file.suffix not in _READERS:
        kinds = ", ".join(_READERS)
        raise EntrackError(f"weights are a file of the kinds {kinds}, found {file.name}")
    try:
        return dict(_READERS[file.suffix](file))
    except (pickle.UnpicklingError, SafetensorError, OSError, ValueError, RuntimeError) as error:
        raise EntrackError(f"{file} is not a {file.suffix} file of named tensors") from error


def folded(weights: Weights, source: str) -> dict[str, NDArray[np.float32]]:
    """Weights and biases to layer3 by torchvision's names, batch norm folded into them."""
    result: dict[str, NDArray[np.float64]] = {}
    for name, parameter in ResNet18().state_dict().items():
        convolution, _, kind = name.rpartition(".")
        if name not in weights and kind == "weight":
            raise EntrackError(
                f"{source} has no {name}: expected ResNet-18 in the names of torchvision and timm"
            )
        if f"{convolution}.bias" in weights:
            result[name] = weights[name]
        else:
            scale, shift = _affine(weights, _norm_of(convolution), source)
            result[name] = weights[name] * scale[:, None, None, None] if kind == "weight" else shift
        if result[name].shape != tuple(parameter.shape):
            found, expected = result[name].shape, tuple(parameter.shape)
            raise EntrackError(f"{name} in {source} has shape {found}, ResNet-18 has {expected}")
    return {name: values.astype(np.float32) for name, values in result.items()}


def _read_npz(file: Path) -> Weights:
    with np.load(file, allow_pickle=False) as arrays:
        return {name: np.asarray(arrays[name], np.float64) for name in arrays.files}


def _read_pth(file: Path) -> Weights:
    return _as_arrays(torch.load(file, map_location="cpu", weights_only=True))


def _read_safetensors(file: Path) -> Weights:
    return _as_arrays(load_file(file))


def _as_arrays(tensors: Mapping[str, torch.Tensor]) -> Weights:
    return {name: tensor.double().numpy() for name, tensor in tensors.items()}


_READERS = {
    ".pth": _read_pth,
    ".pt": _read_pth,
    ".safetensors": _read_safetensors,
    ".npz": _read_npz,
}


def _norm_of(convolution: str) -> str:
    """Name of the batch norm that follows a convolution."""
    if convolution.endswith("downsample.0"):
        return convolution.removesuffix("0") + "1"
    head, _, number = convolution.rpartition("conv")
    return f"{head}bn{number}"


def _affine(
    weights: Weights, norm: str, source: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Batch norm in inference as (scale, shift)."""
    try:
        scale = weights[f"{norm}.weight"] / np.sqrt(weights[f"{norm}.running_var"] + EPSILON)
        return scale, weights[f"{norm}.bias"] - weights[f"{norm}.running_mean"] * scale
    except KeyError as error:
        raise EntrackError(
            f"{source} has no {error.args[0]}: a batch norm is incomplete"
        ) from error
