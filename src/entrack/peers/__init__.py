"""Trackers to compare with, all behind `init(image, box)` and `update(image)`.

A tracker is named by a word:

    default, cf, FOLDER      a model of entrack
    opencv:csrt              a tracker of the installed OpenCV; opencv:nano:DIR with its networks
    module:Class             any Python class with the two methods
    raw:DIR                  results that exist already

and `NAME=` before it gives it another name in tables.
"""

import re
import sys
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import entrack
from entrack.errors import EntrackError
from entrack.model import load_model
from entrack.peers import opencv


class Peer(Protocol):
    """What every tracker can do: `box` and what `update` returns are `(x, y, w, h)`, 0-based.

    `update` may return an object with such a `box` instead, as entrack's own `Estimate`; of its
    other fields an evaluation keeps `score`, `lost`, `sigma`, `entropy` and `search`.
    """

    def init(self, image: Any, box: Any) -> Any:
        """Start on a box in the first frame, forgetting everything before."""
        ...

    def update(self, image: Any) -> Any:
        """Find the target in the next frame."""
        ...


@dataclass(frozen=True)
class Contender:
    """A tracker as it was asked for: its name, and where it comes from."""

    name: str
    spec: str

    @property
    def kind(self) -> str:
        """Return "model", "opencv", "class" or "raw"."""
        head, colon, _ = self.spec.partition(":")
        if colon and head in ("opencv", "raw"):
            return head
        return "class" if colon and _CLASS.fullmatch(self.spec) else "model"

    @property
    def folder(self) -> str:
        """The name as it can stand in a path on every system."""
        return re.sub(r"[^\w.+-]+", "-", self.name)

    @property
    def results(self) -> Path:
        """Where the raw results are, for the kind "raw"."""
        return Path(self.spec.partition(":")[2]).expanduser()

    @cached_property
    def checksum(self) -> str | None:
        """SHA-256 of the model; None where there is no model file."""
        if self.kind == "model":
            return load_model(self.spec).checksum
        return opencv.checksum(self.spec) if self.kind == "opencv" else None

    @cached_property
    def version(self) -> str | None:
        """Version of the code that runs; None where it is not known."""
        if self.kind == "model":
            return f"entrack {entrack.__version__}"
        if self.kind == "opencv":
            return opencv.version()
        if self.kind == "class":
            package = self.spec.partition(".")[0].partition(":")[0]
            version = getattr(_import(package), "__version__", None)
            return None if version is None else f"{package} {version}"
        return None

    def make(self, threads: int | None = None) -> Peer:
        """Make the tracker.

        Raises
        ------
        EntrackError
            If there is no such tracker, or something that it needs is missing.
        """
        if self.kind == "model":
            return entrack.load(self.spec, threads=threads)
        if self.kind == "opencv":
            return opencv.make(self.spec)
        if self.kind == "class":
            return _python_class(self.spec)
        raise EntrackError(f"{self.spec} is a folder of results, which cannot track")


_CLASS = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
_NAMED = re.compile(r"([\w.+ -]+)=(.+)", re.DOTALL)


def parse(text: str) -> Contender:
    """Read a tracker as a user types it.

    >>> parse("ours=raw:results/ATOM.zip")
    Contender(name='ours', spec='raw:results/ATOM.zip')
    >>> parse("raw:results/ATOM.zip").name, parse("opencv:nano:models/nano").name
    ('ATOM', 'opencv:nano')
    """
    named = _NAMED.fullmatch(text)
    if named:
        return Contender(named[1], named[2])
    if text.startswith("raw:"):
        path = Path(text[4:])
        return Contender(path.stem if path.suffix == ".zip" else path.resolve().name, text)
    if text.startswith("opencv:"):
        return Contender(":".join(text.split(":")[:2]), text)
    is_class = _CLASS.fullmatch(text)
    return Contender(
        text if is_class or not Path(text).is_dir() else Path(text).resolve().name, text
    )


def parse_all(texts: list[str]) -> list[Contender]:
    """Read several trackers, no two of one name.

    Raises
    ------
    EntrackError
        If two of them have the same name.
    """
    contenders = [parse(text) for text in texts]
    folders: dict[str, Contender] = {}
    for contender in contenders:
        other = folders.setdefault(contender.folder.lower(), contender)
        if other is not contender:
            raise EntrackError(
                f"two trackers are called {contender.name}: {other.spec} and {contender.spec}; "
                "name one of them, NAME=TRACKER"
            )
    return contenders


def _import(name: str) -> Any:
    if "" not in sys.path:
        sys.path.insert(
            0, ""
        )  # a command does not look for modules in its working folder otherwise
    return import_module(name)


def _python_class(spec: str) -> Peer:
    module, _, name = spec.partition(":")
    try:
        made = getattr(_import(module), name)()
    except ImportError as error:
        raise EntrackError(f"tracker {spec}: cannot import {module}: {error}") from error
    except Exception as error:  # it is somebody's code, which may do anything
        raise EntrackError(f"tracker {spec}: {error}") from error
    missing = [m for m in ("init", "update") if not callable(getattr(made, m, None))]
    if missing:
        raise EntrackError(f"tracker {spec} has no method {' and no method '.join(missing)}")
    return made
