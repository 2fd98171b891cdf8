"""What a synthetic sequence is made to show."""

from collections.abc import Collection
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

from entrack.errors import EntrackError

ATTRIBUTES = {
    "illumination": "IV",
    "partial_occlusion": "POC",
    "deformation": "DEF",
    "motion_blur": "MB",
    "camera_motion": "CM",
    "rotation": "ROT",
    "lookalikes": "BC",
    "scale": "SV",
    "full_occlusion": "FOC",
    "fast_motion": "FM",
    "out_of_view": "OV",
    "low_resolution": "LR",
    "aspect_change": "ARC",
}
"""The switches of `SyntheticConfig` and LaSOT's names for what they switch on."""

HIDING = ("partial_occlusion", "full_occlusion", "out_of_view")
"""What hides the target for a time; each needs a part of the sequence to itself."""

LEAD = 6
"""Frames at both ends of a sequence in which nothing is hidden."""

RAMP = 12
"""Frames that coming and going take at least."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class SyntheticConfig:
    """A synthetic sequence; the default is one easy object that moves about.

    "Size" is the target's √(width × height) in pixels. Build it with `configure`, whose errors are
    one sentence, or with `sample`.
    """

    seed: Annotated[int, Field(ge=0, description="of everything random")] = 0
    length: Annotated[int, Field(ge=1, description="frames")] = 100
    width: Annotated[int, Field(ge=64, le=4096, description="of the frames, pixels")] = 480
    height: Annotated[int, Field(ge=64, le=4096, description="of the frames, pixels")] = 360
    target_size: Annotated[float, Field(ge=8, description="size in the first frame")] = 64.0
    speed: Annotated[float, Field(ge=0, le=1, description="mean path a frame, sizes")] = 0.035
    events: Annotated[
        int, Field(ge=1, description="how often each occlusion, exit, burst of speed occurs")
    ] = 1
    noise: Annotated[float, Field(ge=0, le=50, description="sensor noise, grey levels")] = 2.0
    illumination: Annotated[
        float, Field(ge=0, le=0.9, description="largest change of the light's strength")
    ] = 0.0
    partial_occlusion: Annotated[
        float, Field(ge=0, le=0.8, description="share of the target behind a pole")
    ] = 0.0
    full_occlusion: Annotated[int, Field(ge=0, description="frames fully hidden")] = 0
    deformation: Annotated[
        float, Field(ge=0, le=0.15, description="deviation of the shape's bending, sizes")
    ] = 0.0
    motion_blur: Annotated[
        float, Field(ge=0, le=1, description="share of a frame that the shutter is open")
    ] = 0.0
    camera_motion: Annotated[
        float, Field(ge=0, le=1, description="mean pan a frame, sizes; with roll, zoom, tremor")
    ] = 0.0
    rotation: Annotated[float, Field(ge=0, le=5, description="largest turn, of 360°")] = 0.0
    lookalikes: Annotated[int, Field(ge=0, le=20, description="moving copies of the target")] = 0
    scale: Annotated[float, Field(ge=1, le=8, description="largest ratio to the first size")] = 1.0
    fast_motion: Annotated[
        float, Field(ge=0, le=3, description="peak path a frame in a burst, sizes")
    ] = 0.0
    out_of_view: Annotated[int, Field(ge=0, description="frames outside before it returns")] = 0
    low_resolution: Annotated[
        float, Field(ge=1, le=8, description="times that the sensor's pixels are larger")
    ] = 1.0
    aspect_change: Annotated[
        float, Field(ge=1, le=6, description="largest ratio to the first width : height")
    ] = 1.0

    @property
    def attributes(self) -> tuple[str, ...]:
        """LaSOT's names of what is switched on."""
        neutral = SyntheticConfig()
        return tuple(
            code
            for name, code in ATTRIBUTES.items()
            if getattr(self, name) != getattr(neutral, name)
        )


def configure(**values: Any) -> SyntheticConfig:
    """Build a configuration from its fields' values.

    >>> configure(scale=2, rotation=0.5).attributes
    ('ROT', 'SV')

    Raises
    ------
    EntrackError
        For an unknown field, or a value of another type or out of range: the first that is wrong.
    """
    try:
        return SyntheticConfig(**values)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(map(str, first["loc"]))
        if first["type"] == "unexpected_keyword_argument":
            fields = ", ".join(SyntheticConfig.__dataclass_fields__)
            raise EntrackError(f"no field {name!r}: a synthetic sequence has {fields}") from error
        message = first["msg"][0].lower() + first["msg"][1:]
        raise EntrackError(f"{name}: {message}, found {first['input']!r}") from error


def sample(seed: int, attributes: Collection[str] | None = None, **values: Any) -> SyntheticConfig:
    """A random configuration.

    Parameters
    ----------
    attributes
        What to switch on (keys of `ATTRIBUTES`), how strongly is random; by default one to four of
        them, at random, as far as they fit into the frames.
    values
        Fields that are given rather than random.

    >>> sample(7, ["scale", "lookalikes"]).attributes
    ('BC', 'SV')
    """
    rng = np.random.default_rng([seed, 2])
    for name in attributes or ():
        if name not in ATTRIBUTES:
            raise EntrackError(f"no attribute {name!r}: there are {', '.join(ATTRIBUTES)}")
    given = configure(**values)
    longest = max(given.length // 4, 4)
    hidden = {name: min(int(rng.integers(10, 31)), longest) for name in HIDING}
    hidden["partial_occlusion"] = 2
    chosen = list(attributes or ())
    if attributes is None:
        chosen = rng.choice(list(ATTRIBUTES), rng.integers(1, 5), replace=False).tolist()
        room = given.length - 2 * LEAD
        for name in [name for name in HIDING if name in chosen]:
            room -= given.events * (hidden[name] + 2 * RAMP)
            if room < 0:
                chosen.remove(name)
    strength: dict[str, Any] = {
        "illumination": rng.uniform(0.3, 0.7),
        "partial_occlusion": rng.uniform(0.3, 0.7),
        "deformation": rng.uniform(0.03, 0.07),
        "motion_blur": rng.uniform(0.5, 1.0),
        "camera_motion": rng.uniform(0.02, 0.12),
        "rotation": rng.uniform(0.15, 1.0),
        "lookalikes": int(rng.integers(1, 5)),
        "scale": rng.uniform(1.5, 2.5),
        "full_occlusion": hidden["full_occlusion"],
        "fast_motion": rng.uniform(0.4, 1.1),
        "out_of_view": hidden["out_of_view"],
        "low_resolution": rng.uniform(1.5, 3.0),
        "aspect_change": rng.uniform(1.6, 3.0),
    }
    size = rng.uniform(18, 30) if "low_resolution" in chosen else rng.uniform(36, 90)
    speed = rng.uniform(0.06, 0.1) if "motion_blur" in chosen else rng.uniform(0.015, 0.06)
    shown = {name: strength[name] for name in ATTRIBUTES if name in chosen}
    return configure(**{"seed": seed, "target_size": size, "speed": speed} | shown | values)
