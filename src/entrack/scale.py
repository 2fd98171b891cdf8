"""The scale search: which of the sizes that were looked at the filter answers most."""

import math

import numpy as np
from numpy.typing import NDArray

from entrack import filter as cf
from entrack.config import ScaleConfig
from entrack.target import Look


class ScaleSearch:
    """Compares looks at one place, each of which saw more or less of the image."""

    def __init__(self, config: ScaleConfig) -> None:
        self.config = config
        half = config.steps // 2
        self.zooms: list[float] = (config.factor ** np.arange(-half, half + 1.0)).tolist()
        """What is looked at, in units of the window around the last box."""
        self._sizes = np.log(np.array(self.zooms, np.float32))
        self._parabola = cf.parabola(self._sizes)

    def best(self, looks: list[Look]) -> Look:
        """The look that answers most, after the penalties."""
        half = len(looks) // 2
        penalties = self.config.penalty ** np.abs(np.arange(-half, half + 1))
        return looks[int((_heights(looks) * penalties).argmax())]

    def grown(self, looks: list[Look]) -> float:
        """By what factor the size changes."""
        if not self.config.between:
            return 1 + self.config.rate * (self.best(looks).zoom - 1)
        if len(looks) == 1:
            return 1.0
        top = cf.highest(_heights(looks), self._sizes, self._parabola)
        return math.exp(self.config.rate * top)


def _heights(looks: list[Look]) -> NDArray[np.float32]:
    """How much each of them answers (k,)."""
    return np.array([look.response.max() for look in looks])
