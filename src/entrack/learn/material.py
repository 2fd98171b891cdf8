"""What a policy is trained in: annotated clips and made ones, put on disk (see `store`)."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from entrack.datasets import cutpaste, open_dataset
from entrack.datasets.frames import ImageFiles
from entrack.datasets.sequence import Sequence
from entrack.datasets.synthetic import Props, sample, synthesise
from entrack.errors import EntrackError
from entrack.learn.config import DataConfig
from entrack.learn.env import usable
from entrack.learn.store import bad_frames, keep


@dataclass(frozen=True)
class Source:
    """Where the material is."""

    data: tuple[str, ...]
    """Annotated clips, each `"FORMAT:DIR"`."""
    stills: Path | None = None
    """Pictures of anything, for the warm start."""
    cutouts: Path | None = None
    """Folder with train/, masks/ and images/ to cut things out of."""


class Names(NamedTuple):
    """Clips on disk, by their use."""

    train: tuple[str, ...]
    made: tuple[str, ...]
    validation: tuple[str, ...]


def gather(
    source: Source,
    config: DataConfig,
    folder: Path,
    failed: dict[str, str],
    report: Callable[[int, int], None] = lambda step, steps: None,
) -> Names:
    """Put all clips into `folder`, but those that are there.

    Clips that cannot be used, or not whole, are noted in `failed` with the reason; and those that
    were to be set aside for validation, and are not there: others are learned from.

    Raises
    ------
    EntrackError
        If nothing is left to learn from.
    """
    names: list[str] = []
    clips = list(_makers(source, config))
    for step, (name, make) in enumerate(clips, 1):
        try:
            bad = bad_frames(folder, name)
            if bad is None:
                sequence = make()
                if not usable(sequence):
                    raise EntrackError("no two frames on end show the target with a box")
                bad = keep(folder, replace(sequence, name=name))
            if bad:
                failed[name] = f"{bad} of its frames could not be used"
            names.append(name)
        except EntrackError as error:
            failed[name] = str(error)
        report(step, len(clips))
    aside = {name for name in names if name in config.validation}
    if unknown := sorted(set(config.validation) - {name for name, _ in clips}):
        every = f"{len(unknown)} of {len(config.validation)} validation clips"
        failed[every] = f"not in the data, such as {unknown[0]}"
    made = tuple(name for name in names if name.startswith("made-"))
    train = tuple(n for n in names if n not in made and n not in aside)
    if not train and not made:
        why = next(iter(failed.values()), "there are no clips")
        raise EntrackError(f"nothing to learn from in {', '.join(source.data)}: {why}")
    return Names(train, made, tuple(sorted(aside)))


def _makers(source: Source, config: DataConfig) -> Generator[tuple[str, Callable[[], Sequence]]]:
    """Name and maker of every clip."""
    for spec in source.data:
        dataset = open_dataset(spec)
        for name in dataset.names:
            yield name.replace("/", "_"), partial(dataset.read, name)
    props = Props()
    if source.cutouts:
        props = cutpaste.props(source.cutouts, without=config.validation)
    elif source.stills:
        pictures = ImageFiles(sorted(source.stills.glob("*.jpg")))
        props = Props(pictures, pictures)
    for seed in range(config.made_seed, config.made_seed + config.made):
        yield f"made-{seed}", partial(_made, seed, props)


def _made(seed: int, props: Props) -> Sequence:
    return synthesise(sample(seed, length=80, width=360, height=270), props)
