"""What a worker hands to the learner; it has no need of torch, which takes long to import."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Episode(NamedTuple):
    """One clip tracked: T actions, and the T + 1 states around them."""

    z: NDArray[np.float16]
    """(T + 1, C, n, n)."""
    m: NDArray[np.float32]
    """(T + 1, k)."""
    held: NDArray[np.float32]
    """(T + 1, 4)."""
    action: NDArray[np.float32]
    """(T, 4) in units of the box."""
    best: NDArray[np.float32]
    """(T, 4): the action that would have hit the true box; NaN where the target is absent."""
    reward: NDArray[np.float32]
    """(T,)."""
    iou: NDArray[np.float32]
    """(T,): overlap with the true box, NaN where it is absent."""
    terminated: bool
    """The target was lost; otherwise the clip was over, which is a truncation."""
