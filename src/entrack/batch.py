"""Many clips, each tracked to files of its own: the work behind `entrack track --batch`.

A clip is one source with its objects. Its files appear when it is complete, so that what is there
is done, and a batch that was stopped goes on where it was.
"""

import csv
import re
import shutil
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import IO

import cv2

import entrack
from entrack import box as boxes_
from entrack.boxfiles import SUFFIXES
from entrack.errors import EntrackError
from entrack.evaluation.cluster import run_on_cluster
from entrack.evaluation.pool import Event, run_units
from entrack.files import write_bytes, writing
from entrack.model import SHIPPED
from entrack.run import Recorder, follow
from entrack.tracker import Tracker
from entrack.video import open_source

COLUMNS = ("source", "x", "y", "w", "h")
"""What a list must have; `name`, `start` and `stop` are optional."""
_REPORT_EVERY = 0.5  # seconds


@dataclass(frozen=True)
class Clip:
    """One source with its objects, and where its results go."""

    name: str
    source: str
    boxes: tuple[tuple[float, ...], ...]
    start: int = 0
    stop: int | None = None
    table: Path | None = None
    """Boxes of every frame; see `entrack.boxfiles`."""
    video: Path | None = None
    model: str = "default"
    threads: int = 1

    @property
    def files(self) -> list[Path]:
        """The files that are there when the clip is done."""
        table, count = self.table, len(self.boxes)
        tables = [table] if table else []
        if table and table.suffix.lower() == ".txt" and count > 1:
            tables = [table.with_stem(f"{table.stem}_{n + 1}") for n in range(count)]
        return tables + ([self.video] if self.video else [])

    @property
    def failed(self) -> Path:
        """The file that says why the clip failed, if it did."""
        path = self.table or self.video
        assert path is not None
        return path.with_name(f"{path.name}.failed.txt")

    def done(self) -> bool:
        """Whether all files are there."""
        return all(path.is_file() for path in self.files)

    def with_model(self, places: dict[str, str]) -> "Clip":
        """Return it with its model where it lies on this machine; see `cluster.Payload`."""
        return replace(self, model=places.get(self.model, self.model))


def read_list(
    path: Path, table: Path | None, video: Path | None, model: str = "default", threads: int = 1
) -> list[Clip]:
    """Read a CSV list of clips, with a header.

    A row is an object: `source,x,y,w,h` and, if there are such columns, `name`, `start` and `stop`.
    Rows of the same name are objects of one clip. The name is otherwise that of the source without
    its suffix; sources are looked for from the list's own folder.

    Parameters
    ----------
    table, video
        Where each clip's boxes and pictures go, with `{name}` in it; one of them may be None.
    model, threads
        Of every clip's tracker.

    Raises
    ------
    EntrackError
        With the line of whatever cannot be used.
    """
    for pattern in (table, video):
        if pattern and "{name}" not in str(pattern):
            raise EntrackError(f"{pattern} would be written for every clip: put {{name}} into it")
    if not table and not video:
        raise EntrackError("a batch writes a table or a video of each clip")
    if table and table.suffix.lower() not in SUFFIXES:
        raise EntrackError(f"boxes are written as {' '.join(SUFFIXES)}, found {table.name}")
    folder = path.parent.resolve()
    patterns = [str(p.resolve()) if p else None for p in (table, video)]
    clips: dict[str, Clip] = {}
    with _opened(path) as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        missing = set(COLUMNS) - set(reader.fieldnames or ())
        if missing:
            names = ", ".join(COLUMNS)
            raise EntrackError(f"{path} begins with the columns {names}: no {sorted(missing)}")
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            clip = _clip(row, folder, where)
            before = clips.get(clip.name)
            if before:
                if replace(before, boxes=clip.boxes) != clip:
                    raise EntrackError(f"{where}: another clip is called {clip.name} already")
                clip = replace(before, boxes=before.boxes + clip.boxes)
            clips[clip.name] = clip
    if not clips:
        raise EntrackError(f"{path} lists no clip")

    def placed(clip: Clip) -> Clip:
        table, video = (Path(p.replace("{name}", clip.name)) if p else None for p in patterns)
        return replace(clip, table=table, video=video, model=model, threads=threads)

    return [placed(clip) for clip in clips.values()]


@contextmanager
def _opened(path: Path) -> Generator[IO[str]]:
    if not path.is_file():
        raise EntrackError(f"there is no list {path}")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            yield file
    except (OSError, UnicodeDecodeError) as error:
        raise EntrackError(f"cannot read the list {path}: {error}") from error


def _clip(row: dict[str, str], folder: Path, where: str) -> Clip:
    """One row as a clip of one object."""
    source = row["source"] or ""
    name = row.get("name") or Path(source).stem
    if not re.fullmatch(r"(?!\.)[\w.+-]+(/(?!\.)[\w.+-]+)*", name):
        raise EntrackError(f"{where}: {name!r} is no name for a file: add a column `name`")
    try:
        box = boxes_.parse(",".join(row[side] or "" for side in "xywh"))
        start, stop = int(row.get("start") or 0), row.get("stop")
        end = int(stop) if stop else None
    except ValueError as error:
        raise EntrackError(f"{where}: {error}") from error
    if "://" not in source:
        source = str(folder / source)
    return Clip(name, source, (tuple(box.tolist()),), start, end)


def run_clip(clip: Clip, report: Callable[[int], None]) -> int:
    """Track a clip and put its files in their places; return its frames.

    Raises
    ------
    EntrackError
        If the source or a box cannot be used, or the source breaks off.
    """
    cv2.setNumThreads(clip.threads)
    tracker = _tracker(clip.model, clip.threads)
    table, video = (path and _hidden(path) / path.name for path in (clip.table, clip.video))
    folders = {path.parent for path in (table, video) if path}
    try:
        for folder in folders:
            with writing(folder):
                folder.mkdir(parents=True, exist_ok=True)
        with open_source(clip.source, clip.start, clip.stop) as source:
            recorder = Recorder(table, video, len(clip.boxes), source.fps)
            frames, reported = 0, time.perf_counter()
            with recorder, closing(follow(tracker, source, clip.boxes)) as steps:
                for frame, estimates in steps:
                    recorder.write(frame, estimates)
                    frames += 1
                    if time.perf_counter() - reported > _REPORT_EVERY:
                        reported = time.perf_counter()
                        report(frames)
        if not frames:
            raise EntrackError(f"{clip.source} has no frame")
        for path in recorder.paths:
            with writing(path):
                path.replace(path.parent.parent / path.name)
    finally:
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
    return frames


def _hidden(path: Path) -> Path:
    """The folder in which a file lies until its clip is complete."""
    return path.parent / f".{path.name}.unfinished"


@lru_cache(maxsize=1)
def _tracker(model: str, threads: int) -> Tracker:
    return entrack.load(model, threads=threads)


def run_clips(
    clips: Sequence[Clip], workers: int | None = None, cluster: str | None = None
) -> Generator[Event]:
    """Track clips in local processes, or on Ray; see `run_units` and `run_on_cluster`.

    A clip that fails leaves a file `*.failed.txt` that says why.
    """
    threads = clips[0].threads if clips else 1
    if cluster is None:
        events = run_units(run_clip, clips, workers or 1, threads)
    else:
        models = sorted({clip.model for clip in clips} - set(SHIPPED))
        events = run_on_cluster(run_clip, clips, cluster, workers, threads, models)
    with closing(events):
        for event in events:
            clip = clips[event.unit]
            if event.kind == "done":
                clip.failed.unlink(missing_ok=True)
                if not clip.done():
                    why = f"{clip.files[0]} is not there: do all machines see its folder?"
                    event = replace(event, kind="failed", value=why)
            if event.kind == "failed":
                with writing(clip.failed):
                    clip.failed.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(clip.failed, f"{event.value}\n".encode())
            yield event
