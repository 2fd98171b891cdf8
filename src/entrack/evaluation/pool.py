"""Independent units of work in processes, any of which may die.

A worker is a fresh interpreter (spawn: forked copies of OpenVINO, OpenCV or CUDA may hang) that
takes one unit after the other. A unit whose worker died is given to the next worker, up to three
times. `entrack.evaluation.cluster` does the same on Ray.
"""

import os
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from typing import Any, Literal

from entrack.errors import EntrackError

ATTEMPTS = 3
"""A unit that kills its worker so often is given up."""

Report = Callable[[int], None]
Work = Callable[[Any, Report], Any]


@dataclass(frozen=True)
class Event:
    """What happened to one unit.

    Parameters
    ----------
    unit
        Its index.
    kind
        "progress", "done", "failed", or "again": its worker died, and it will be tried once more.
        "nothing": nothing has happened for as long as the caller wanted to wait; no unit then.
    value
        What the work reported, returned, or failed with (one sentence and a traceback).
    """

    unit: int
    kind: Literal["progress", "done", "failed", "again", "nothing"]
    value: Any = None


NOTHING = Event(-1, "nothing")
Pause = Callable[[], float | None]


def for_ever() -> None:
    """Wait until something happens."""


class _Worker:
    """A process with one unit at a time."""

    def __init__(self, work: Work, threads: int) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        with _threads(threads):
            self.process.start()
        theirs.close()  # so that the pipe ends when the process does
        self.unit: int | None = None

    def give(self, unit: int, payload: Any) -> None:
        """Hand over a unit; a worker that is dead already is found out when it does not answer."""
        self.unit = unit
        try:
            self.pipe.send(payload)
        except OSError:
            pass

    def stop(self) -> None:
        """End the process, whatever it does."""
        self.process.terminate()
        self.process.join(5)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.pipe.close()


def attempt(work: Work, payload: Any, report: Report) -> tuple[Literal["done", "failed"], Any]:
    """Do a unit; return what came out, or one sentence and a traceback."""
    try:
        return "done", work(payload, report)
    except Exception as error:
        kind = "" if isinstance(error, EntrackError) else f"{type(error).__name__}: "
        return "failed", f"{kind}{error}\n\n{traceback.format_exc()}"


def run_units(
    work: Work, payloads: Sequence[Any], workers: int, threads: int = 1, pause: Pause = for_ever
) -> Generator[Event]:
    """Run `work(payload, report)` for every payload, in order, on `workers` processes.

    `work` is a function of a module; `report(n)` yields a progress event. Closing the iterator
    ends the workers.

    Units are handed out while the caller waits for the next event. Who has work of its own asks in
    between: `pause` says how many seconds an event is waited for, each time.
    """
    waiting, deaths = deque(range(len(payloads))), Counter[int]()
    crew: dict[Any, _Worker] = {}
    try:
        while waiting or any(worker.unit is not None for worker in crew.values()):
            while waiting and len(crew) < min(workers, len(payloads)):
                worker, unit = _Worker(work, threads), waiting.popleft()
                crew[worker.pipe] = worker
                worker.give(unit, payloads[unit])
            ready = connection.wait(list(crew), pause())
            if not ready:
                yield NOTHING
            for pipe in ready:
                worker = crew[pipe]
                unit = worker.unit
                assert unit is not None
                try:
                    kind, value = worker.pipe.recv()
                except (EOFError, OSError):
                    del crew[pipe]
                    worker.stop()
                    deaths[unit] += 1
                    if deaths[unit] < ATTEMPTS:
                        waiting.appendleft(unit)
                        yield Event(unit, "again")
                    else:
                        how = _how(worker.process.exitcode)
                        yield Event(unit, "failed", f"its worker {how}, {ATTEMPTS} times")
                    continue
                if kind != "progress":
                    if waiting:
                        following = waiting.popleft()
                        worker.give(following, payloads[following])
                    else:
                        worker.stop()
                        del crew[pipe]
                yield Event(unit, kind, value)
    finally:
        for worker in crew.values():
            worker.stop()


def _serve(pipe: Any, work: Work) -> None:
    """Do units until the pipe closes. Ctrl-C is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        while True:
            payload = pipe.recv()
            pipe.send(attempt(work, payload, lambda n: pipe.send(("progress", n))))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass


def _end_with_parent() -> None:
    """A parent that was killed told nobody: its run may be started again, and two would write."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _how(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        return f"was killed by {signal.Signals(-exitcode).name}"
    return f"ended with code {exitcode}"


@contextmanager
def _threads(count: int) -> Generator[None]:
    """Limit the numeric libraries of a process that is started now; they read this once."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, str(count)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
