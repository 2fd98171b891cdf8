"""Files that appear under their name only when they are whole."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from entrack.errors import EntrackError


def unfinished(path: Path) -> Path:
    """Name of `path` while it is being written; a reader never meets half a file.

    >>> unfinished(Path("out/boxes.csv")).name
    'boxes.csv.part'
    """
    return path.with_name(path.name + ".part")


@contextmanager
def writing(path: Path) -> Generator[None, None, None]:
    """Turn an `OSError` (no such folder, disk full, …) into one sentence about `path`."""
    try:
        yield
    except OSError as error:
        raise EntrackError(f"cannot write {path}: {error.strerror or error}") from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file, or leave the one that was there."""
    with writing(path):
        unfinished(path).write_bytes(data)
        unfinished(path).replace(path)
