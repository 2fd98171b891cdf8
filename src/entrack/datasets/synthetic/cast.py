"""Who plays in a synthetic scene, and before what."""

from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.random import Generator

from entrack.datasets.frames import Image
from entrack.datasets.synthetic import texture
from entrack.datasets.synthetic.config import SyntheticConfig
from entrack.datasets.synthetic.sprite import Sprite, deforming, sprite

_T = TypeVar("_T")
_CUTOUT = 144  # pixels a side of a made-up thing


@dataclass(frozen=True)
class Props:
    """Pictures to play with; what is missing is made up.

    Parameters
    ----------
    backgrounds
        BGR pictures, such as an `ImageFiles`.
    textures
        BGR pictures of which targets and occluders are cut.
    sprites
        Things with a shape of their own, as `entrack.datasets.cutpaste` cuts them.
    """

    backgrounds: SequenceOf[Image] = ()
    textures: SequenceOf[Image] = ()
    sprites: SequenceOf[Sprite] = ()

    def board(self, rng: Generator, width: int, height: int) -> Sprite:
        """Something solid to hide behind, of the given size in pixels."""
        pictures = self.textures or self.backgrounds
        picture = pick(rng, pictures) if pictures else None
        return sprite(texture.board(rng, width, height, picture))


@dataclass(frozen=True)
class Cast:
    """The target, those that look like it, and the world that they are in."""

    target: Sprite
    lookalikes: list[Sprite]
    background: Image


def choose(config: SyntheticConfig, props: Props) -> Cast:
    """Choose or make up everything that is to be seen, occluders aside."""
    rng = np.random.default_rng([config.seed, 0])
    if props.sprites:
        target = pick(rng, props.sprites)
        target = target.mirrored if rng.random() < 0.5 else target
    else:
        textured = pick(rng, props.textures) if props.textures else None
        picture = texture.cutout(rng, _CUTOUT, textured)
        film = deforming(rng, picture, config.deformation) if config.deformation else picture
        target = sprite(film)
    others = [target.tinted(rng.normal(1, 0.06, 3)) for _ in range(config.lookalikes)]
    for index in range(1, len(others)):  # the first is a copy, the rest may be others of its world
        if props.sprites and rng.random() < 0.4:
            others[index] = pick(rng, props.sprites)
    wide, high = round(1.25 * config.width), round(1.25 * config.height)
    if props.backgrounds:
        background = texture.crop(rng, pick(rng, props.backgrounds), wide, high)
    else:
        reach = 8 * config.camera_motion * config.target_size * np.sqrt(config.length)
        background = texture.backdrop(
            rng, wide + round(min(reach, wide)), high + round(min(reach, high))
        )
    return Cast(target, others, background)


def pick(rng: Generator, things: SequenceOf[_T]) -> _T:
    """Any of them."""
    return things[int(rng.integers(len(things)))]
