"""Every tracker of the installed OpenCV, behind `init` and `update`."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack.errors import EntrackError
from entrack.quiet import errors_alone

PLAIN = {
    "kcf": "TrackerKCF",
    "csrt": "TrackerCSRT",
    "mil": "TrackerMIL",
    "mosse": "legacy.TrackerMOSSE",
    "boosting": "legacy.TrackerBoosting",
    "medianflow": "legacy.TrackerMedianFlow",
    "tld": "legacy.TrackerTLD",
    "legacy-kcf": "legacy.TrackerKCF",
    "legacy-csrt": "legacy.TrackerCSRT",
    "legacy-mil": "legacy.TrackerMIL",
}
"""Trackers without a network. The legacy ones take and give fractions of a pixel."""

NETWORKS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "nano": ("TrackerNano", {"backbone": "*backbone*.onnx", "neckhead": "*head*.onnx"}),
    "vit": ("TrackerVit", {"net": "*vit*.onnx"}),
    "dasiamrpn": (
        "TrackerDaSiamRPN",
        {"kernel_cls1": "*cls1*.onnx", "kernel_r1": "*r1*.onnx", "model": "*model*.onnx"},
    ),
}
"""Trackers with networks: the class, and each parameter's file in the folder that is named."""


@dataclass(frozen=True)
class Answer:
    """What a tracker of OpenCV says of one frame."""

    box: NDArray[np.float64]
    """`(x, y, w, h)` (4,) float64; where the tracker reports failure, its last one."""
    lost: bool
    """Whether it reports failure."""
    score: float | None
    """Its `getTrackingScore`, in [0, 1]; None for a tracker without."""


class OpenCVTracker:
    """One tracker of OpenCV."""

    def __init__(self, name: str, settings: Mapping[str, Path]) -> None:
        self._class = PLAIN[name] if name in PLAIN else NETWORKS[name][0]
        self._settings = settings
        self._tracker: Any = None
        self._box: NDArray[np.float64] = np.zeros(4)

    def init(self, image: Any, box: ArrayLike) -> None:
        """Start on `box`; OpenCV's newer trackers take whole pixels."""
        self._tracker = self._create()
        self._box = np.asarray(box, np.float64)
        legacy = self._class.startswith("legacy.")
        corner = self._box if legacy else np.round(self._box)
        self._tracker.init(image, tuple(corner.tolist() if legacy else map(int, corner)))

    def update(self, image: Any) -> Answer:
        """Find the target in the next frame."""
        found, box = self._tracker.update(image)
        if found:
            self._box = np.array(box, np.float64)
        return Answer(self._box, not found, self._score())

    def _score(self) -> float | None:
        sure = getattr(self._tracker, "getTrackingScore", None)
        score = -1.0 if sure is None else float(sure())
        return score if score >= 0 else None  # −1 is what trackers without a score give

    def _create(self) -> Any:
        owner: Any = cv2
        *modules, name = self._class.split(".")
        for module in modules:
            owner = getattr(owner, module, None)
        if not hasattr(owner, f"{name}_create"):
            raise EntrackError(
                f"the installed OpenCV {cv2.__version__} has no {self._class}: "
                "opencv-contrib-python-headless has it"
            )
        create = getattr(owner, f"{name}_create")
        if not self._settings:
            return create()
        parameters = getattr(owner, f"{name}_Params")()
        for key, path in self._settings.items():
            setattr(parameters, key, str(path))
        with errors_alone():  # nothing but the processor computes here
            return create(parameters)


def make(spec: str) -> OpenCVTracker:
    """Make the tracker of `opencv:NAME` or `opencv:NAME:DIR`.

    Raises
    ------
    EntrackError
        If OpenCV has no such tracker, or a network of it is missing.
    """
    name, files = _parse(spec)
    return OpenCVTracker(name, files)


def checksum(spec: str) -> str | None:
    """SHA-256 over the tracker's networks; None for one without."""
    _, files = _parse(spec)
    if not files:
        return None
    digest = hashlib.sha256()
    for path in files.values():
        digest.update(path.read_bytes())
    return digest.hexdigest()


def version() -> str:
    """Version of the installed OpenCV."""
    return f"opencv {cv2.__version__}"


def _parse(spec: str) -> tuple[str, dict[str, Path]]:
    _, name, *rest = spec.split(":", 2)
    if name in PLAIN:
        return name, {}
    if name not in NETWORKS:
        known = ", ".join([*PLAIN, *NETWORKS])
        raise EntrackError(f"OpenCV has no tracker {name}: expected one of {known}")
    patterns = NETWORKS[name][1]
    if not rest:
        needed = " and ".join(patterns.values())
        raise EntrackError(f"opencv:{name} needs its networks: opencv:{name}:DIR with {needed}")
    return name, {key: _only(Path(rest[0]).expanduser(), p) for key, p in patterns.items()}


def _only(place: Path, pattern: str) -> Path:
    if place.is_file():
        return place
    found = sorted(place.glob(pattern))
    if len(found) != 1:
        raise EntrackError(f"{len(found)} files {pattern} in {place}, expected one")
    return found[0]
