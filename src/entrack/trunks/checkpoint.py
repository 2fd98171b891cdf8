"""A training run on disk: resumable state without pickle, and a log."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open  # pyright: ignore[reportUnknownVariableType]
from safetensors.torch import load_file  # pyright: ignore[reportUnknownVariableType]
from safetensors.torch import save as in_bytes
from torch import Tensor, nn

from entrack.errors import EntrackError
from entrack.files import write_bytes, writing
from entrack.trunks.curves import Curves

Optimisers = torch.optim.Optimizer | Mapping[str, torch.optim.Optimizer]


def save(path: Path, network: nn.Module, optimisers: Optimisers, step: int) -> None:
    """Write weights, the state of one or several optimisers, and the step count, atomically."""
    tensors = {f"network.{k}": v.contiguous() for k, v in network.state_dict().items()}
    for name, optimiser in _named(optimisers).items():
        for index, slots in optimiser.state_dict()["state"].items():
            tensors |= {f"{name}.{index}.{k}": v.contiguous() for k, v in slots.items()}
    tensors["step"] = torch.tensor(step)
    # No two tensors may share memory in the file.
    tensors = {name: tensor.clone() for name, tensor in tensors.items()}
    write_bytes(path, in_bytes(tensors))


def steps(path: Path) -> int:
    """How many steps were done when `path` was written; 0 where there is none."""
    if not path.exists():
        return 0
    with safe_open(path, "np") as file:  # pyright: ignore[reportUnknownVariableType]
        return int(file.get_tensor("step"))  # pyright: ignore


def load(path: Path, network: nn.Module, optimisers: Optimisers) -> int:
    """Restore what `save` wrote; return the step count."""
    named = _named(optimisers)
    slots: dict[str, dict[int, dict[str, Tensor]]] = {name: {} for name in named}
    weights: dict[str, Tensor] = {}
    tensors: dict[str, Tensor] = load_file(path)
    step = int(tensors.pop("step"))
    for key, tensor in tensors.items():
        kind, _, name = key.partition(".")
        if kind == "network":
            weights[name] = tensor
        else:
            index, _, slot = name.partition(".")
            slots[kind].setdefault(int(index), {})[slot] = tensor
    network.load_state_dict(weights)
    for name, optimiser in named.items():
        optimiser.load_state_dict({**optimiser.state_dict(), "state": slots[name]})
    return step


def _named(optimisers: Optimisers) -> Mapping[str, torch.optim.Optimizer]:
    one = isinstance(optimisers, torch.optim.Optimizer)
    return {"optimiser": optimisers} if one else optimisers


class Log:
    """One row a report, to `log.csv` and, where it is installed, to TensorBoard."""

    def __init__(self, folder: Path, name: str, resume_at: int) -> None:
        self.path = folder / f"{name}.csv"
        self._drop_rows_from(resume_at)
        try:
            self.curves = Curves(folder / "tensorboard" / name, resume_at)
        except ImportError:
            self.curves = None

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Add the row of `step`."""
        row = {"step": step} | {k: round(v, 6) for k, v in values.items()}
        with writing(self.path):
            fresh = not self.path.exists()
            with self.path.open("a", newline="") as file:
                writer = csv.DictWriter(file, list(row), lineterminator="\n")
                if fresh:
                    writer.writeheader()
                writer.writerow(row)
        if self.curves:
            for key, value in values.items():
                self.curves.add(key, value, step)

    def _drop_rows_from(self, step: int) -> None:
        """Rows after the last checkpoint are written again when a run resumes."""
        if not self.path.exists():
            return
        lines = self.path.read_text().splitlines(keepends=True)
        whole = [line for line in lines if line.endswith("\n")]  # the last may be torn
        if not whole:
            return self.path.unlink()
        head, *rows = whole
        kept = [row for row in rows if int(row.split(",")[0]) <= step]
        return write_bytes(self.path, "".join([head, *kept]).encode())


def claim(folder: Path, config: Mapping[str, Any], resume: bool) -> None:
    """Make a run folder for `config`, or go on in one that was made for the same."""
    path = folder / "config.json"
    if path.exists():
        old, new = json.loads(path.read_text()), json.loads(json.dumps(config))
        if old != new:
            raise EntrackError(
                f"{folder} holds a run of another configuration: {_differing(old, new)}"
            )
        if not resume:
            raise EntrackError(f"{folder} holds a run already: add --resume, or name a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    write_bytes(path, json.dumps(config, indent=2).encode())


def _differing(old: Mapping[str, Any], new: Mapping[str, Any], most: int = 5) -> str:
    """Keys that differ, with both values: "sac.alpha is 0.2 there, 0.3 here"."""
    a, b = _flat(old), _flat(new)
    keys = sorted(k for k in a.keys() | b.keys() if a.get(k) != b.get(k))
    words = [f"{k} is {_word(a, k)} there, {_word(b, k)} here" for k in keys[:most]]
    return "; ".join(words) + (f"; and {len(keys) - most} more" if len(keys) > most else "")


def _word(values: Mapping[str, Any], key: str) -> str:
    return json.dumps(values[key]) if key in values else "missing"


def _flat(values: Any, prefix: str = "") -> dict[str, Any]:
    """Nested values by their dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        flat |= (
            _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
        )
    return flat
