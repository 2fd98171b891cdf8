"""What a trunk is trained on: stills, annotated clips, clips without annotation, made sequences."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from entrack.datasets import cutpaste, open_dataset
from entrack.datasets.folder import VIDEOS
from entrack.datasets.frames import ImageFiles
from entrack.datasets.sequence import Sequence
from entrack.datasets.synthetic import Props, sample, synthesise
from entrack.trunks.crops import Image, load_clips, load_stills


@checked(frozen=True, config=ConfigDict(extra="forbid"))
class MaterialConfig:
    """How much of it is taken, and what is left alone."""

    validation: tuple[str, ...] = ()
    """Clips that training never sees."""
    every: int = Field(default=3, ge=1)
    """One of so many frames of each clip is kept in memory."""
    made: int = Field(default=160, ge=0)
    """Synthetic sequences; with cut-outs of real things where there are any."""
    made_seed: int = Field(default=1000, ge=0)
    """Seed of the first of them."""


@dataclass
class Material:
    """What a trunk is trained on, in memory."""

    stills: list[Image]
    clips: list[Sequence] = field(default_factory=list[Sequence])
    made: list[Sequence] = field(default_factory=list[Sequence])
    unlabelled: list[Image] = field(default_factory=list[Image])

    @property
    def pictures(self) -> list[Image]:
        """Every picture, for distillation."""
        frames = [image for clip in self.clips for image in clip.frames]
        return self.stills + frames + self.unlabelled


def gather(
    config: MaterialConfig,
    data: list[str],
    stills: Path,
    unlabelled: Path | None = None,
    cutouts: Path | None = None,
    report: Callable[[str], None] = lambda what: None,
) -> Material:
    """Read everything into memory, but for made sequences, which are rendered when asked for.

    Parameters
    ----------
    data
        Annotated clips, each `"FORMAT:DIR"`.
    stills, unlabelled
        Folders of pictures and of videos.
    cutouts
        A folder with `train/`, `masks/` and `images/`, see `entrack.datasets.cutpaste`.
    """
    pictures = load_stills(stills)
    report(f"{len(pictures)} stills")
    clips: list[Sequence] = []
    for spec in data:
        dataset = open_dataset(spec)
        names = [name for name in dataset.names if name not in config.validation]
        clips += [thin(dataset.read(name), config.every) for name in names]
        report(f"{len(names)} clips of {spec}, {len(dataset) - len(names)} left for validation")
    videos = sorted(unlabelled.iterdir()) if unlabelled else []
    frames = load_clips((v for v in videos if v.suffix in VIDEOS), 5)
    backgrounds = ImageFiles(sorted(stills.glob("*.jpg")))
    props = (
        cutpaste.props(cutouts, without=config.validation)
        if cutouts
        else Props(backgrounds, backgrounds)
    )
    configs = (
        sample(config.made_seed + k, length=80, width=360, height=270) for k in range(config.made)
    )
    made = [synthesise(c, props) for c in configs]
    report(f"{len(frames)} frames without annotation, {len(made)} made sequences")
    return Material(pictures, clips, made, frames)


def thin(sequence: Sequence, every: int) -> Sequence:
    """Every `every`-th frame of a sequence, read once and kept in memory."""
    chosen = range(0, len(sequence), every)
    frames = [sequence.frames[i] for i in chosen]
    rows = list(chosen)
    return Sequence(sequence.name, frames, sequence.boxes[rows], sequence.absent[rows])
