"""The text files that benchmarks are made of, in a folder or in a zip file."""

import os
import re
import zipfile
import zlib
from collections.abc import Collection
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from entrack.errors import EntrackError
from entrack.files import read_bytes

_LARGEST = 64_000_000  # bytes of one text: a million frames
_ZIP_ERRORS = (OSError, ValueError, EOFError, NotImplementedError, zipfile.BadZipFile)
_MEANING = {4: "x, y, w, h", 8: "four corners"}


class Texts:
    """Texts by relative path, whether `root` is a folder or a zip file."""

    def __init__(self, root: Path) -> None:
        self.root = root
        if not os.path.exists(root):
            raise EntrackError(f"there is no folder or file {root}")
        if not root.is_dir() and not zipfile.is_zipfile(root):
            raise EntrackError(f"{root} is neither a folder nor a zip file")

    @cached_property
    def names(self) -> frozenset[str]:
        """Every file's path relative to the root, with forward slashes."""
        if self.root.is_dir():
            found = (p for p in self.root.rglob("*") if p.is_file())
            return frozenset(p.relative_to(self.root).as_posix() for p in found)
        return frozenset(name for name in self._archive.namelist() if not name.endswith("/"))

    def __contains__(self, name: str) -> bool:
        if self.root.is_dir():
            # Which answers for names that no file can have, too: too long, or with a zero byte.
            return os.path.isfile(self.root / name)
        return name in self.names

    def bytes(self, name: str) -> bytes:
        """Content of one file."""
        if self.root.is_dir():
            return read_bytes(self.root / name, _LARGEST)
        archive = self._archive
        try:
            with archive.open(name) as file:
                data = file.read(_LARGEST + 1)  # whatever size the archive states
        except (*_ZIP_ERRORS, KeyError, RuntimeError, zlib.error) as error:
            raise EntrackError(f"cannot read {self.root / name}: {error}") from error
        if len(data) > _LARGEST:
            raise EntrackError(f"{self.root / name} has more than {_LARGEST} bytes")
        return data

    def text(self, name: str) -> str:
        """Content of one file as text."""
        return self.bytes(name).decode("utf-8", "replace")

    def table(self, name: str, columns: Collection[int]) -> NDArray[np.float64]:
        """Content of one file as numbers; see `parse_table`."""
        return parse_table(self.text(name), columns, str(self.root / name))

    @cached_property
    def _archive(self) -> zipfile.ZipFile:
        try:
            return zipfile.ZipFile(self.root)
        except _ZIP_ERRORS as error:
            raise EntrackError(f"{self.root} is no zip file that can be read: {error}") from error


def parse_table(text: str, columns: Collection[int], where: str) -> NDArray[np.float64]:
    r"""Read rows of numbers separated by commas, tabs or spaces.

    Parameters
    ----------
    columns
        How many numbers a row may have; all rows have the same number.
    where
        The file's name, for the error.

    >>> parse_table("1,2,3,4\n5\t6\t7\tnan\n", [4], "gt.txt")
    array([[ 1.,  2.,  3.,  4.],
           [ 5.,  6.,  7., nan]])

    Raises
    ------
    EntrackError
        For an empty file, a word that is no number, or a row of another length.
    """
    rows = [line.split() for line in text.translate(_BLANKS).splitlines()]
    while rows and not rows[-1]:
        rows.pop()
    if not rows:
        raise EntrackError(f"{where} is empty, expected one line a frame")
    width = len(rows[0])
    for number, row in enumerate(rows, 1):
        if len(row) != width or width not in columns:
            expected = " or ".join(
                f"{c} ({_MEANING[c]})" if c in _MEANING else str(c) for c in columns
            )
            raise EntrackError(f"{where}, line {number}: {len(row)} numbers, expected {expected}")
    numbers: list[list[float]] = []
    try:
        for row in rows:
            numbers.append(list(map(float, row)))
    except ValueError as error:
        raise EntrackError(f"{where}, line {len(numbers) + 1}: {error}") from error
    return np.array(numbers)


_BLANKS = str.maketrans({",": " ", ";": " ", "\t": " ", "\ufeff": " "})


def name_key(name: str) -> str:
    """Reduce a sequence's name to what the toolkits' spellings of it have in common.

    >>> name_key("Human4-2") == name_key("human4.2") == name_key("human4_2")
    True
    """
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
