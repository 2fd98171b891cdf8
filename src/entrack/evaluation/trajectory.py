"""Files of supervised runs: VOT's text and vot-toolkit's binary form."""

import struct
from collections.abc import Iterator

import numpy as np

from entrack.errors import EntrackError
from entrack.evaluation.region import Regions
from entrack.evaluation.vot import REGION, Trajectory


def read_text(text: str, where: str) -> Trajectory:
    r"""Read VOT's text: a line is a code, `x,y,w,h`, or four corners.

    >>> read_text("1\n0,0,2,2\n2\n0\n", "bag_001.txt").codes
    array([ 1, -1,  2,  0])
    """
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            rows.append([float(word) for word in line.split(",")])
        except ValueError:
            raise EntrackError(f"{where}, line {number}: {line[:40]!r} is no region") from None
    return _trajectory(rows, where)


def write_text(run: Trajectory) -> str:
    """Write VOT's text; the inverse of `read_text`, to four decimals."""
    lines = (
        str(row[0]) if len(row) == 1 else ",".join(f"{value:.4f}" for value in row)
        for row in _rows(run)
    )
    return "\n".join(lines) + "\n"


def read_binary(data: bytes, where: str) -> Trajectory:
    """Read the binary trajectories of vot-toolkit ≥ 0.5: codes, rectangles and quadrilaterals."""
    try:
        return _trajectory(list(_binary_rows(data, where)), where)
    except struct.error as error:
        raise EntrackError(f"{where} ends in the middle of a frame") from error


def _binary_rows(data: bytes, where: str) -> Iterator[list[float]]:
    version, length = struct.unpack_from("<hI", data)
    if version != 1:
        raise EntrackError(f"{where} is no binary trajectory of version 1")
    at = struct.calcsize("<hI")
    for _ in range(length):
        (kind,) = struct.unpack_from("<B", data, at)
        at += 1
        if kind == 2:
            (corners,) = struct.unpack_from("<H", data, at)
            at += 2
            form = f"<{2 * corners}f"
        elif kind in (0, 1):
            form = ("<I", "<4f")[kind]
        else:
            raise EntrackError(f"{where} holds masks or points, expected boxes or quadrilaterals")
        yield list(struct.unpack_from(form, data, at))
        at += struct.calcsize(form)


def write_binary(run: Trajectory) -> bytes:
    """Write what `read_binary` reads, in single precision."""
    frames = [struct.pack("<hI", 1, len(run))]
    for row in _rows(run):
        if len(row) == 1:
            frames.append(struct.pack("<BI", 0, row[0]))
        elif len(row) == 4:
            frames.append(struct.pack("<B4f", 1, *row))
        else:
            frames.append(struct.pack("<BH8f", 2, 4, *row))
    return b"".join(frames)


def _rows(run: Trajectory) -> Iterator[list[int] | list[float]]:
    for code, corners, upright in zip(
        run.codes.tolist(), run.regions.corners, run.regions.upright, strict=True
    ):
        if code != REGION:
            yield [code]
        elif upright:
            yield [*corners[:2], *(corners[4:6] - corners[:2])]
        else:
            yield corners.tolist()


def _trajectory(rows: list[list[float]], where: str) -> Trajectory:
    if not rows:
        raise EntrackError(f"{where} is empty, expected one region a frame")
    codes = np.full(len(rows), REGION)
    corners = np.full((len(rows), 8), np.nan)
    upright = np.zeros(len(rows), bool)
    for frame, row in enumerate(rows):
        if len(row) == 1 and row[0] in (0, 1, 2):
            codes[frame] = int(row[0])
        elif len(row) == 4:
            corners[frame], upright[frame] = Regions.of([row]).corners[0], True
        elif len(row) == 8:
            corners[frame] = row
        else:
            raise EntrackError(
                f"{where}, frame {frame + 1}: {len(row)} numbers, "
                "expected a code 0, 1 or 2, a box of 4 or corners of 8"
            )
    return Trajectory(codes, Regions(corners, upright))
