"""Files that appear under their name only when they are whole, and are read only if they fit."""

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


def read_bytes(path: Path, largest: int = 256_000_000) -> bytes:
    """Content of a file of at most `largest` bytes; what a run writes has no more by default.

    Raises
    ------
    EntrackError
        If there is no such file, or it is larger: what it stands for is never that large.
    """
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte in it
        raise EntrackError(f"cannot read {path}: {getattr(error, 'strerror', error)}") from error
    if len(data) > largest:
        raise EntrackError(f"{path} has more than the {largest} bytes that such a file may have")
    return data


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
        try:
            unfinished(path).write_bytes(data)
            unfinished(path).replace(path)
        except OSError:
            unfinished(path).unlink(missing_ok=True)  # half a file would only fill a full disk
            raise


def copy(source: Path, path: Path) -> None:
    """Copy a file, whole or not at all."""
    write_bytes(path, read_bytes(source, largest=2**31))
