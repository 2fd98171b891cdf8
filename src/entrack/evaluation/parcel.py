"""A model folder on its way to another machine."""

import getpass
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from entrack.config import parse, read_toml
from entrack.errors import EntrackError
from entrack.model import ModelFile, load_model
from entrack.trunk import sha256

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Parcel:
    """What names a packed model: small, unlike its files."""

    checksum: str
    """SHA-256 of `model.toml`, which names those of everything else."""
    folder: str
    """The model's folder among the files; a model may share files with others beside it."""

    def unpack(self, files: Callable[[], Files]) -> Path:
        """Return the model's folder on this machine; `files` is asked for only the first time.

        Raises
        ------
        EntrackError
            If what lies there is another model.
        """
        place = Path(tempfile.gettempdir()) / f"entrack-models-{getpass.getuser()}" / self.checksum
        if not place.is_dir():
            place.parent.mkdir(mode=0o700, exist_ok=True)
            part = Path(tempfile.mkdtemp(dir=place.parent))
            for name, data in files().items():
                (part / name).parent.mkdir(parents=True, exist_ok=True)
                (part / name).write_bytes(data)
            try:
                part.rename(place)
            except OSError:  # another worker of this machine was faster
                shutil.rmtree(part)
        model = place / self.folder
        if sha256(model / "model.toml") != self.checksum:
            raise EntrackError(f"{model} holds another model than its name says: remove it")
        return model


def pack(folder: str) -> tuple[Parcel, Files]:
    """Read a model folder with all files that its `model.toml` names."""
    model = load_model(folder)
    path = model.folder.resolve() / "model.toml"
    content = parse(ModelFile, read_toml(path), str(path))
    paths = [path, *((path.parent / entry.path).resolve() for entry in content.files.values())]
    base = Path(os.path.commonpath([p.parent for p in paths]))
    files = {p.relative_to(base).as_posix(): p.read_bytes() for p in paths}
    return Parcel(model.checksum, path.parent.relative_to(base).as_posix()), files
