"""Single-object visual tracking by maximum-entropy reinforcement learning, in real time on a CPU.

tracker = entrack.load("default")
tracker.init(frame, box=(x, y, w, h))
estimate = tracker.update(next_frame)
"""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

# Read by OpenCV when it is imported: a picture of a few bytes may claim a billion pixels. 16K fits.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(2**27))
# OpenVINO looks for this package when it is imported, and with it forks a process that reports to
# its makers over the network, unasked. The fork may also leave numpy waiting for a thread for ever.
sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]

# ruff: noqa: E402
from entrack.errors import EntrackError
from entrack.model import load_model
from entrack.policy import load_policy
from entrack.tracker import Estimate, Tracker
from entrack.trunk import load_trunk

if TYPE_CHECKING:
    from entrack.run import track

__all__ = ["EntrackError", "Estimate", "Tracker", "load", "track"]
__version__ = "0.1.0"


def load(
    model: str | Path = "default",
    *,
    engine: str = "openvino",
    threads: int | None = None,
    device: str = "cpu",
    precision: str = "model",
) -> Tracker:
    """Make a tracker from a shipped model ("default", "cf", …) or a model folder.

    Parameters
    ----------
    model
        A name or a folder with a `model.toml`.
    engine
        What runs the trunk: "openvino", or "onnxruntime" (extra `gpu`).
    threads
        Threads of the engine; None lets it choose.
    device
        "cpu", or with "onnxruntime" also "cuda", which falls back to the CPU with one warning.
    precision
        Of the trunk: "model" computes as its file says, "fp32" in float, which takes thrice the
        time and gives the same boxes on every engine (extra `train`).
    """
    opened = load_model(model)
    trunk = load_trunk(opened.trunk, engine, threads, device, precision)
    policy = None
    if opened.policy and opened.config.policy:
        policy = load_policy(opened.policy, opened.config.policy, threads or os.cpu_count() or 1)
    return Tracker(opened.config, trunk, policy)


def __getattr__(name: str) -> Any:
    """`track` brings video and drawing with it, so it is imported when it is first asked for."""
    if name == "track":
        from entrack.run import track

        return track
    raise AttributeError(f"module 'entrack' has no attribute {name!r}")
