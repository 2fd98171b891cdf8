"""The same evaluation in local processes and on Ray: seconds, and whether the results are equal.

    python benchmarks/pools.py --data otb:OTB --work DIR [--workers 2] [--tracker cf] [--rounds 1]

Three ways take turns: local processes; Ray, which is started for the run and ended after it; and
Ray that runs already, as a cluster does. Times are those of whole runs, so they include the start
of the workers. Prints a table; exit code 1 if a result differs, or if a cluster that runs has less
than .85 of the local pool's speed.
"""

import argparse
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from entrack.evaluation.run import Evaluation, Options

BAR = 0.85
LOCAL, RUNNING = "local processes", "Ray, running before"


def _wake() -> None:
    """A task that only starts its worker."""
    time.sleep(0.1)


@contextmanager
def cluster(workers: int) -> Iterator[None]:
    """Ray on this machine, ready to work."""
    import ray

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    quiet = {"include_dashboard": False, "log_to_driver": False, "logging_level": "ERROR"}
    ray.init("local", num_cpus=workers, _node_ip_address="127.0.0.1", **quiet)
    ray.get([ray.remote(_wake).remote() for _ in range(workers)])
    yield
    ray.shutdown()


def run(args, name: str, options: Options) -> tuple[float, dict[str, bytes]]:
    """Seconds of a run from nothing, and its result files but for the times."""
    out = args.work / name
    shutil.rmtree(out, ignore_errors=True)
    began = time.perf_counter()
    outcome = Evaluation.prepare([args.data], [args.tracker], out, options).run()
    seconds = time.perf_counter() - began
    if outcome.failed:
        sys.exit(f"{name}: {outcome.failed}")
    files = [p for p in out.rglob("*.txt") if not p.name.endswith(".time.txt")]
    return seconds, {p.relative_to(out).as_posix(): p.read_bytes() for p in files}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tracker", default="cf")
    parser.add_argument("--rounds", type=int, default=1)
    args = parser.parse_args()
    kinds = {
        LOCAL: Options(workers=args.workers),
        "Ray, started": Options(workers=args.workers, cluster="local"),
        RUNNING: Options(workers=args.workers, cluster="auto"),
    }
    times: dict[str, list[float]] = {name: [] for name in kinds}
    results: dict[str, dict[str, bytes]] = {}
    for _ in range(args.rounds):
        for name, options in kinds.items():
            with cluster(args.workers) if name == RUNNING else nullcontext():
                seconds, results[name] = run(args, name, options)
            times[name].append(seconds)
    medians = {name: float(np.median(seconds)) for name, seconds in times.items()}
    for name, median in medians.items():
        print(f"{name:20} {median:8.1f} s   {medians[LOCAL] / median:.2f} of the local speed")
    equal = all(found == results[LOCAL] for found in results.values())
    print(f"{len(results[LOCAL])} result files, {'equal' if equal else 'DIFFERENT'}")
    return int(not equal or medians[LOCAL] / medians[RUNNING] < BAR)


if __name__ == "__main__":
    sys.exit(main())
