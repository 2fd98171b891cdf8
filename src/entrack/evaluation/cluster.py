"""Independent units of work on Ray: the processes of this machine, or of many.

The events are those of `entrack.evaluation.pool`, but for progress within a unit. Ray starts the
workers, finds room for each unit, moves the models and notices what dies; here is only the list of
what is to be done, and done again.
"""

import os
import sys
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol, Self

import entrack
from entrack.errors import EntrackError, require
from entrack.evaluation.parcel import Parcel, pack
from entrack.evaluation.pool import ATTEMPTS, NOTHING, Event, Pause, Work, attempt, for_ever

_AHEAD = 2
"""Units handed over for each place to work, so that none waits for this process."""


_Sent = tuple[str, Parcel, Any]
"""A model's folder here, what names it, and Ray's reference to its files."""


class Payload(Protocol):
    """A unit that can be done on another machine."""

    def with_model(self, places: dict[str, str]) -> Self:
        """Return it with the folder that its model has there, by the folder that it has here."""
        ...


def run_on_cluster(
    work: Work,
    payloads: Sequence[Payload],
    address: str,
    workers: int | None = None,
    threads: int = 1,
    models: Sequence[str] = (),
    pause: Pause = for_ever,
) -> Generator[Event]:
    """Run `work(payload, report)` for every payload on Ray; see `run_units`.

    Parameters
    ----------
    address
        Of the cluster, as `ray.init` takes it; "local" starts one of `workers` processes on this
        machine, "auto" only where none runs already.
    workers
        Units at a time; None: as many as there are places of `threads` CPUs.
    models
        Model folders that the payloads need: each is sent to each machine once.

    Raises
    ------
    EntrackError
        If Ray is not installed, there is no such cluster, or no machine of it has the threads.
    """
    ray = require("ray", "cluster")
    with _connected(ray, address, workers, threads):
        packed = {folder: pack(folder) for folder in models}
        parcels = [(folder, parcel, ray.put(files)) for folder, (parcel, files) in packed.items()]
        # Retries are counted here, where they can be told; an idle machine goes before a busy one.
        options = {"num_cpus": threads, "max_retries": 0, "scheduling_strategy": "SPREAD"}
        task = ray.remote(**options)(_do)
        version, paths = entrack.__version__, [os.path.abspath(path) for path in sys.path]
        waiting, deaths = deque(range(len(payloads))), Counter[int]()
        running: dict[Any, int] = {}
        try:
            while waiting or running:
                room = workers or _AHEAD * max(1, _places(ray, threads))
                while waiting and len(running) < room:
                    unit = waiting.popleft()
                    running[task.remote(work, payloads[unit], parcels, paths, version)] = unit
                ray.wait(list(running), num_returns=1, timeout=pause())
                ready, _ = ray.wait(list(running), num_returns=len(running), timeout=0)
                if not ready:
                    yield NOTHING
                for ref in ready:
                    unit = running.pop(ref)
                    try:
                        kind, value = ray.get(ref)
                    except ray.exceptions.RayTaskError as error:
                        kind, value = "failed", str(error.cause)
                    except ray.exceptions.LocalRayletDiedError as error:
                        why = "Ray has ended on this machine: what is done stays, call it again"
                        raise EntrackError(why) from error
                    except ray.exceptions.RayError as error:
                        deaths[unit] += 1
                        if deaths[unit] < ATTEMPTS:
                            waiting.appendleft(unit)
                            kind, value = "again", None
                        else:
                            why = type(error).__name__
                            kind, value = "failed", f"its worker died ({why}), {ATTEMPTS} times"
                    yield Event(unit, kind, value)
        finally:
            for ref in running:
                ray.cancel(ref, force=True)


def _do(
    work: Work, payload: Payload, parcels: Sequence[_Sent], paths: Sequence[str], version: str
) -> tuple[str, Any]:
    """Do a unit on whatever machine this is."""
    # What can be imported where the call was made can be here, if it is here.
    sys.path += [path for path in paths if path not in sys.path and os.path.exists(path)]

    def here(payload: Payload, report: Callable[[int], None]) -> Any:
        if entrack.__version__ != version:
            found = entrack.__version__
            raise EntrackError(f"a machine has entrack {found}, the one that asks {version}")
        ray = require("ray", "cluster")
        places = {
            folder: str(parcel.unpack(lambda files=files: ray.get(files)))
            for folder, parcel, files in parcels
        }
        return work(payload.with_model(places) if places else payload, report)

    # Progress within a unit is not sent: thousands of workers would report to one process.
    return attempt(here, payload, lambda done: None)


def _places(ray: Any, threads: int) -> int:
    """Units that fit on the machines that are there now."""
    nodes = [node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]]
    return int(sum(cpus // threads for cpus in nodes))


@contextmanager
def _connected(ray: Any, address: str, workers: int | None, threads: int) -> Generator[None]:
    """Join a cluster, or start one, and leave it at the end; a connection that is there stays."""
    joined = not ray.is_initialized()
    if joined:
        _join(ray, address, workers and workers * threads)
    try:
        if not _places(ray, threads):
            most = max(node["Resources"].get("CPU", 0) for node in ray.nodes())
            raise EntrackError(f"no machine of the cluster has {threads} CPUs, at most {most:g}")
        yield
    finally:
        if joined:
            ray.shutdown()


def _join(ray: Any, address: str, cpus: int | None) -> None:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    quiet = {"log_to_driver": False, "logging_level": "ERROR"}
    if address != "local":
        try:
            ray.init(address, **quiet)
            return
        except ConnectionError as error:
            if address != "auto":
                raise EntrackError(f"there is no Ray cluster at {address}: {error}") from error
    here = {"include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    try:
        ray.init("local", num_cpus=cpus, **here, **quiet)
    except Exception as error:  # Ray's own: it waits 30 seconds, which a busy machine may exceed
        raise EntrackError(f"Ray did not start on this machine: {error}") from error
