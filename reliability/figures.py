"""How every program here ends: one line of figures, a JSON file, and 1 if a promise was broken."""

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

OUT = Path("out/reliability")


def parser(doc: str | None) -> argparse.ArgumentParser:
    """A command line with what all have in common."""
    words = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    words.add_argument("--out", type=Path, default=OUT, help="folder of the JSON file")
    return words


def tell(name: str, figures: Mapping[str, Any], broken: Sequence[str], out: Path) -> int:
    """Print the figures, keep them in `<out>/<name>.json`, and return the exit code.

    Parameters
    ----------
    broken
        Promises that did not hold, a sentence each.
    """
    whole = {
        "date": time.strftime("%Y-%m-%d %H:%M"),
        "machine": {
            "cores": os.cpu_count(),
            "load": [round(x, 2) for x in os.getloadavg()],
            "python": platform.python_version(),
        },
        "figures": dict(figures),
        "broken": list(broken),
    }
    out.mkdir(parents=True, exist_ok=True)
    part = out / f"{name}.json.part"
    part.write_text(json.dumps(whole, indent=1) + "\n")
    part.replace(out / f"{name}.json")
    words = ", ".join(f"{key} {value}" for key, value in figures.items())
    print(f"{name}: {words}: {'kept' if not broken else 'BROKEN'}", flush=True)
    for sentence in broken:
        print(f"  {sentence}", file=sys.stderr)
    return 1 if broken else 0
