"""Curves for TensorBoard, written at once: torch's writer has a thread that a full disk breaks."""

import os
import time
from pathlib import Path
from typing import Any

from entrack.files import writing


class Curves:
    """A file of events in `folder`, beside those of earlier calls.

    Parameters
    ----------
    resume_at
        Points of earlier files after this step are not shown.

    Raises
    ------
    ImportError
        If TensorBoard is not installed.
    EntrackError
        If a file cannot be written, now or later.
    """

    def __init__(self, folder: Path, resume_at: int) -> None:
        from tensorboard.compat.proto.event_pb2 import (  # pyright: ignore[reportMissingImports]
            Event,  # pyright: ignore
            SessionLog,  # pyright: ignore
        )
        from tensorboard.summary.writer.record_writer import (  # pyright: ignore[reportMissingImports]
            RecordWriter,  # pyright: ignore
        )

        self._event: Any = Event
        # The names sort by time, and no two calls have the same.
        self.path = folder / f"events.out.tfevents.{time.time_ns()}.{os.getpid()}"
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            self._records: Any = RecordWriter(self.path.open("wb", buffering=0))
        self._write(file_version="brain.Event:2")
        self._write(session_log=SessionLog(status=SessionLog.START), step=resume_at + 1)

    def add(self, name: str, value: float, step: int) -> None:
        """Add a point to the curve `name`."""
        self._write(summary={"value": [{"tag": name, "simple_value": value}]}, step=step)

    def _write(self, **content: Any) -> None:
        with writing(self.path):
            event = self._event(wall_time=time.time(), **content)
            self._records.write(event.SerializeToString())
