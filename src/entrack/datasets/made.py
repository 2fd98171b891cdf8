"""`synthetic:`, a folder that `entrack data synth` wrote, or a suite made when it is asked for.

    synthetic:DIR
    synthetic:hard                              60 sequences, always the same
    synthetic:hard,seed=5000,count=24           others of their kind
    synthetic:hard,props=DIR                    with real things cut out of DIR's clips

A folder of the suite's name is opened by its full path.
"""

from pathlib import Path

from entrack.datasets.got10k import ORIGIN, open_layout
from entrack.datasets.sequence import Dataset, Sequence
from entrack.errors import EntrackError

SUITE = "hard"


def open_synthetic(place: Path) -> Dataset:
    """Open a folder or a suite.

    A suite's pictures are rendered whenever they are asked for, which takes 1 to 2 ms each.

    Raises
    ------
    EntrackError
        For a missing folder, or an option that is not known.
    """
    word, *options = str(place).split(",")
    return _open_suite(options) if word == SUITE else open_layout("synthetic", place)


def _open_suite(options: list[str]) -> Dataset:
    # Here, as a folder needs none of it.
    from entrack.datasets.cutpaste import props as props_of
    from entrack.datasets.synthetic import hard_plan, hard_sequence

    numbers, folder = {"count": 60, "seed": 0}, None
    for option in options:
        key, _, value = option.partition("=")
        if key == "props" and value:
            folder = Path(value).expanduser().resolve()
        elif key in numbers and value.isdecimal():
            numbers[key] = int(value)
        else:
            expected = "count=NUMBER, seed=NUMBER or props=DIR"
            raise EntrackError(f"synthetic:{SUITE} has no option {option!r}, expected {expected}")
    plan = dict(hard_plan(**numbers))
    if not plan:
        raise EntrackError(f"synthetic:{SUITE},count=0 has no sequence")
    props = None if folder is None else props_of(folder)

    def read(name: str) -> Sequence:
        return hard_sequence(name, plan[name], props)

    words = [SUITE, *(f"{key}={value}" for key, value in numbers.items())]
    made = ",".join([*words, *([f"props={folder}"] if folder else [])])
    return Dataset("synthetic", Path(made), tuple(plan), read, origin=ORIGIN, made=made)
