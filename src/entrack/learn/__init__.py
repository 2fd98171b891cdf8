"""Learning the policy: the environment, soft actor-critic, and training (extra `train`)."""

from typing import TYPE_CHECKING, Any

from entrack.errors import require

if TYPE_CHECKING:
    from entrack.learn.env import TrackingEnv

__all__ = ["TrackingEnv"]

require("gymnasium", "train").register(
    "entrack/Track-v0", entry_point="entrack.learn.env:TrackingEnv"
)


def __getattr__(name: str) -> Any:
    """`TrackingEnv` is imported when it is first asked for, as torch comes with it."""
    if name == "TrackingEnv":
        from entrack.learn.env import TrackingEnv

        return TrackingEnv
    raise AttributeError(f"module 'entrack.learn' has no attribute {name!r}")
