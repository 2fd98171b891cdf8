"""Synthetic sequences: seeded, with exact boxes, showing what one asks for.

>>> from entrack.datasets.synthetic import configure, synthesise
>>> sequence = synthesise(configure(seed=1, length=3, width=96, height=64, target_size=20))
>>> sequence.frames[2].shape, sequence.boxes.shape
((64, 96, 3), (3, 4))
"""

from collections.abc import Iterator
from collections.abc import Sequence as SequenceOf
from dataclasses import replace

from entrack.datasets.frames import Image
from entrack.datasets.sequence import Sequence
from entrack.datasets.synthetic.config import ATTRIBUTES, SyntheticConfig, configure, sample
from entrack.datasets.synthetic.scene import Actor, Scene
from entrack.datasets.synthetic.sprite import Sprite, sprite
from entrack.datasets.synthetic.stage import Props, compose
from entrack.datasets.synthetic.write import write
from entrack.errors import EntrackError

__all__ = [
    "ATTRIBUTES",
    "Actor",
    "Film",
    "Props",
    "Scene",
    "Sprite",
    "SyntheticConfig",
    "configure",
    "hard",
    "hard_plan",
    "hard_sequence",
    "sample",
    "sprite",
    "synthesise",
    "write",
]


class Film(SequenceOf[Image]):
    """A scene's frames, rendered when asked for; `scene` knows more: `visible`, `alpha`."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def __len__(self) -> int:
        return len(self.scene)

    def __getitem__(self, index: int) -> Image:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self.scene.render(index)


def synthesise(
    config: SyntheticConfig, props: Props | None = None, name: str | None = None
) -> Sequence:
    """Make a sequence: the same configuration and props give the same pictures and boxes.

    Boxes are whole where the target is hidden or outside the picture; `absent` says where no more
    than a fiftieth of it shows. `sequence.frames.scene.visible` has the share that shows.
    """
    scene = compose(config, Props() if props is None else props)
    label = f"synthetic-{config.seed:06d}" if name is None else name
    return Sequence(
        label,
        Film(scene),
        scene.boxes,
        scene.absent,
        attributes=config.attributes,
        size=(config.width, config.height),
    )


def hard(count: int = 60, seed: int = 0, props: Props | None = None) -> Iterator[Sequence]:
    """Sequences for testing whether a tracker knows that it is lost, and finds its target again.

    In turn: a full occlusion of 10 to 40 frames, an exit of 10 to 40 frames and a return, and
    look-alikes; every second one has two of these.
    """
    for name, config in hard_plan(count, seed):
        yield hard_sequence(name, config, props)


def hard_plan(count: int = 60, seed: int = 0) -> Iterator[tuple[str, SyntheticConfig]]:
    """Names and configurations of `hard`, without making anything yet."""
    kinds = ("full_occlusion", "out_of_view", "lookalikes")
    for index in range(count):
        names = [kinds[index % 3]] + ([kinds[(index + 1) % 3]] if index % 2 else [])
        frames = 10 + (7 * index) % 31
        hidden = {name: frames for name in names if name != "lookalikes"}
        config = sample(seed + index, names, length=240, **hidden)
        yield f"hard-{seed + index:06d}-{'-'.join(names)}", config


def hard_sequence(name: str, config: SyntheticConfig, props: Props | None = None) -> Sequence:
    """Make one of `hard_plan`; what cannot be staged with given props is tried with other ones."""
    for seed in range(config.seed, config.seed + _CASTINGS * _APART, _APART):
        try:
            return synthesise(replace(config, seed=seed), props, name)
        except EntrackError:
            if props is None:
                raise
    raise EntrackError(f"found no way to show {name} with the pictures given")


_CASTINGS = 10
_APART = 1_000_000
"""Seeds that sequences of one suite never use for one another."""
