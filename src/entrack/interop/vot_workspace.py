"""`trackers.ini` and `config.yaml` of a vot-toolkit workspace."""

import re
import shlex
import sys
from configparser import ConfigParser
from io import StringIO
from pathlib import Path

from entrack.errors import EntrackError
from entrack.files import write_bytes, writing
from entrack.model import SHIPPED, load_model


def write_workspace(
    folder: Path, model: str = "default", name: str = "entrack", stack: str | None = None
) -> list[Path]:
    """Add a model to a workspace's trackers; return the files that were written.

    Parameters
    ----------
    folder
        The workspace; made if it does not exist. Other trackers of its `trackers.ini` stay.
    model
        A shipped model's name, or a model folder.
    name
        The tracker's name there; `<name>-trax` is the same one as a TraX server.
    stack
        Such as "vot2018/shortterm": makes `config.yaml`, for sequences below `sequences`.

    Raises
    ------
    EntrackError
        If there is no such model, the name cannot be used or is taken, or `config.yaml` exists.
    """
    if not re.fullmatch(r"[\w-]+", name, re.ASCII):
        raise EntrackError(f"vot-toolkit knows trackers by letters, digits, - and _: found {name}")
    load_model(model)
    model = model if model in SHIPPED else str(Path(model).resolve())
    path, config = folder / "trackers.ini", folder / "config.yaml"
    if stack and config.exists():
        raise EntrackError(f"{config} exists: leave out --stack, or choose another folder")
    before = path.read_text("utf-8") if path.is_file() else ""
    text = before + ("\n" if before else "") + _entries(name, model)
    if f"[{name}]" in before or f"[{name}-trax]" in before:
        raise EntrackError(f"{path} has a tracker {name} already: choose another --name")
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_bytes(path, text.encode())
    if not stack:
        return [path]
    write_bytes(config, f"registry: [./trackers.ini]\nstack: {stack}\n".encode())
    return [path, config]


def _entries(name: str, model: str) -> str:
    label = f"{name} ({Path(model).name})"
    server = shlex.join([sys.executable, "-m", "entrack.interop.vot", model])
    ini = ConfigParser(interpolation=None)
    ini[name] = {
        "label": label,
        "protocol": "python",
        "command": "entrack.interop.vot:create_tracker",
        "arg_model": model.replace("%", "%%"),  # the toolkit reads them with interpolation
    }
    ini[f"{name}-trax"] = {
        "label": f"{label}, TraX",
        "protocol": "trax",
        "command": server.replace("%", "%%"),
    }
    text = StringIO()
    ini.write(text)
    return text.getvalue().rstrip("\n") + "\n"
