"""Benchmarks as lists of sequences: `open_dataset("otb:DIR")`."""

from importlib import import_module
from pathlib import Path

from entrack.datasets.sequence import Dataset, Sequence
from entrack.errors import EntrackError

__all__ = ["FORMATS", "Dataset", "Sequence", "open_dataset"]

FORMATS = {
    "otb": "entrack.datasets.ranges:open_otb",
    "uav123": "entrack.datasets.ranges:open_uav123",
    "lasot": "entrack.datasets.lasot:open_lasot",
    "vot2016": "entrack.datasets.vot:open_vot2016",
    "vot2018": "entrack.datasets.vot:open_vot2018",
    "vot2019": "entrack.datasets.vot:open_vot2019",
    "got10k": "entrack.datasets.got10k:open_got10k",
    "folder": "entrack.datasets.folder:open_folder",
    "synthetic": "entrack.datasets.made:open_synthetic",
}


def open_dataset(spec: str) -> Dataset:
    """Open `"FORMAT:DIR"`, for example `"otb:/data/OTB100"`, as a list of sequences.

    Instead of a folder, a JSON file with the ground truth alone is enough for scoring.

    Raises
    ------
    EntrackError
        For an unknown format, a missing folder, or a folder without a sequence of that format.
    """
    name, colon, place = spec.partition(":")
    if not colon or name not in FORMATS:
        known = ", ".join(FORMATS)
        raise EntrackError(f"a dataset is FORMAT:DIR with FORMAT one of {known}; found {spec!r}")
    path = Path(place).expanduser()
    if path.suffix == ".json":
        from entrack.datasets.annotations import open_annotations

        return open_annotations(name, path)
    module, function = FORMATS[name].split(":")
    return getattr(import_module(module), function)(path)
