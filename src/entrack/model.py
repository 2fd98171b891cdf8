"""A model folder: `model.toml` names the configuration and, with their checksums, the files.

    name = "cf"
    description = "…"

    [files.trunk]
    path = "trunk.onnx"
    sha256 = "…"

    [config.window]
    context = 3.0

Nothing in it is ever executed or unpickled: TOML, ONNX and safetensors only.
"""

import os
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path

import tomli_w
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass as checked

from entrack.config import Config, parse, read_toml
from entrack.errors import EntrackError
from entrack.trunk import sha256

_SUFFIXES = (".onnx", ".safetensors")
"""Formats that hold numbers, and nothing that is executed when they are read."""
_LARGEST = 500_000_000  # bytes of one file of a model
SHIPPED = ("default", "longterm", "cf", "cf-baseline", "policy", "quick", "paper")


@checked(frozen=True, config=ConfigDict(extra="forbid"))
class FileEntry:
    """A file of the folder, by relative path."""

    path: str
    sha256: str


@checked(frozen=True, config=ConfigDict(extra="forbid"))
class ModelFile:
    """What `model.toml` holds."""

    name: str
    description: str
    files: dict[str, FileEntry]
    config: Config


@dataclass(frozen=True)
class Model:
    """A model folder that has been checked."""

    folder: Path
    name: str
    config: Config
    trunk: Path
    policy: Path | None
    """Weights of the policy; None where the filter alone decides."""
    checksum: str
    """SHA-256 of `model.toml`, which names the checksums of everything else."""


def assets() -> Path:
    """The folder of what the package ships."""
    return Path(str(files("entrack") / "assets"))


def load_model(name: str | Path) -> Model:
    """Open a shipped model by name, or a model folder by path, and verify its files.

    Raises
    ------
    EntrackError
        If there is no such model, or a file of it is missing or was altered.
    """
    folder = assets() / "models" / str(name) if name in SHIPPED else Path(name)
    path = folder / "model.toml"
    if not os.path.isfile(path):  # which answers for names that no file can have, too
        shipped = ", ".join(SHIPPED)
        raise EntrackError(f"no model {name}: expected {shipped}, or a folder with a model.toml")
    content = parse(ModelFile, read_toml(path), str(path))
    if "trunk" not in content.files:
        raise EntrackError(f"{path} names no trunk under [files]")
    for entry in content.files.values():
        file = folder / entry.path
        if file.suffix not in _SUFFIXES:
            found = f"{path} names {entry.path}"
            raise EntrackError(f"{found}: a model's files are {' and '.join(_SUFFIXES)}")
        if not os.path.isfile(file):
            raise EntrackError(f"model {name} is incomplete: {file} is missing")
        if file.stat().st_size > _LARGEST:
            raise EntrackError(f"{file} has more than the {_LARGEST} bytes of the largest model")
        if sha256(file) != entry.sha256:
            raise EntrackError(f"{file} was altered: its SHA-256 is not the one in {path.name}")
    if (content.config.policy is None) != ("policy" not in content.files):
        raise EntrackError(f"{path} needs both [config.policy] and [files.policy], or neither")
    at = {kind: folder / entry.path for kind, entry in content.files.items()}
    checksum = sha256(path)
    return Model(folder, content.name, content.config, at["trunk"], at.get("policy"), checksum)


def save_model(
    folder: Path,
    name: str,
    description: str,
    config: Config,
    trunk: Path,
    policy: Path | None = None,
) -> None:
    """Write `model.toml` for files that lie in `folder` or may be reached from there."""
    files = {"trunk": trunk} | ({"policy": policy} if policy else {})
    content = {
        "name": name,
        "description": description,
        "files": {
            kind: {"path": os.path.relpath(file, folder), "sha256": sha256(file)}
            for kind, file in files.items()
        },
        "config": {k: v for k, v in asdict(config).items() if v is not None},
    }
    folder.mkdir(parents=True, exist_ok=True)
    temporary = folder / "model.toml.part"
    temporary.write_text(tomli_w.dumps(content), encoding="utf-8")
    os.replace(temporary, folder / "model.toml")
