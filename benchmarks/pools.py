"""The same evaluation in local processes and on Ray: seconds, and whether the results are equal.

    python benchmarks/pools.py --data otb:OTB --work DIR [--workers 2] [--tracker cf] [--rounds 1]

Times are those of whole runs, so they include the start of the workers and of Ray. Prints a table;
exit code 1 if a result differs, or if Ray has less than .85 of the local pool's speed.
"""

import argparse
import shutil
import sys
import time
from pathlib import Path

import numpy as np

from entrack.evaluation.run import Evaluation, Options

BAR = 0.85


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
        "local": Options(workers=args.workers),
        "ray": Options(workers=args.workers, cluster="local"),
    }
    times: dict[str, list[float]] = {name: [] for name in kinds}
    results: dict[str, dict[str, bytes]] = {}
    for _ in range(args.rounds):
        for name, options in kinds.items():
            seconds, results[name] = run(args, name, options)
            times[name].append(seconds)
    local, on_ray = (float(np.median(times[name])) for name in kinds)
    equal = results["local"] == results["ray"]
    print(f"local pool {local:8.1f} s")
    print(f"Ray        {on_ray:8.1f} s   {local / on_ray:.2f} of its speed, at least {BAR}")
    print(f"{len(results['local'])} result files, {'equal' if equal else 'DIFFERENT'}")
    return int(not equal or local / on_ray < BAR)


if __name__ == "__main__":
    sys.exit(main())
