"""Train a trunk from start to end: distil, fine-tune through the filter, export."""

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass as checked

from entrack.errors import EntrackError
from entrack.trunk import load_trunk
from entrack.trunks import checkpoint, crops
from entrack.trunks.distil import DistilConfig, distil
from entrack.trunks.export import export
from entrack.trunks.finetune import FinetuneConfig, finetune
from entrack.trunks.importing import read_resnet18
from entrack.trunks.material import Material, MaterialConfig
from entrack.trunks.networks import Student, StudentConfig, sound_kernels
from entrack.trunks.pairs import Pair, from_sequence, from_still

Report = Callable[[str, int, int, dict[str, float]], None]


@checked(frozen=True, config=ConfigDict(extra="forbid"))
class TrunkTrainConfig:
    """Everything that decides what a trunk becomes."""

    seed: int = 0
    """Of weights and data; the same seed gives the same trunk on the same machine."""
    threads: int = Field(default=2, ge=1)
    """Threads of torch and of the teacher."""
    material: MaterialConfig = Field(default_factory=MaterialConfig)
    student: StudentConfig = Field(default_factory=StudentConfig)
    distil: DistilConfig = Field(default_factory=DistilConfig)
    finetune: tuple[FinetuneConfig, ...] = Field(default_factory=lambda: (FinetuneConfig(),))
    """Stages, one after the other; none leaves the distilled trunk as it is."""


def pairs_from(material: Material, config: FinetuneConfig) -> Callable[..., list[Pair]]:
    """A function that draws pairs from clips, made sequences and stills in the wanted mixture."""

    def one(rng: np.random.Generator) -> Pair | None:
        kind = rng.random()
        if kind < config.stills or not (material.clips or material.made):
            image = material.stills[int(rng.integers(len(material.stills)))]
            return from_still(image, material.stills, config.pair, rng)
        use_made = material.made and (kind < config.stills + config.made or not material.clips)
        source = material.made if use_made else material.clips
        return from_sequence(source[int(rng.integers(len(source)))], config.pair, rng)

    def draw(rng: np.random.Generator, count: int) -> list[Pair]:
        pairs = list(islice(filter(None, (one(rng) for _ in range(20 * count))), count))
        if len(pairs) < count:
            raise EntrackError("the training clips hold hardly any usable boxes")
        return pairs

    return draw


def train_trunk(
    config: TrunkTrainConfig,
    material: Material,
    teacher_weights: Path,
    run: Path,
    resume: bool = False,
    report: Report = lambda stage, step, steps, values: None,
) -> Path:
    """Train a student from `run` on, where an earlier call left off; return `run/trunk.onnx`."""
    checkpoint.claim(run, asdict(config), resume)
    torch.set_num_threads(config.threads)
    torch.manual_seed(config.seed)
    student = Student(config.student)
    pictures = material.pictures
    size = config.distil.size
    # The teacher is not ours to leave lying about.
    with TemporaryDirectory() as folder, sound_kernels(student):
        export(read_resnet18(teacher_weights), Path(folder) / "teacher.onnx")
        teach = load_trunk(Path(folder) / "teacher.onnx", threads=config.threads)

        def anchor(rng: np.random.Generator, count: int):
            patches = crops.batch(pictures, count, size, rng)
            return patches, teach(patches)

        distil(student, teach, pictures, config.distil, run, config.seed, partial(report, "distil"))
        for stage, settings in enumerate(config.finetune, 1):
            draw = pairs_from(material, settings)
            told = partial(report, f"finetune {stage}")
            finetune(student, draw, anchor, settings, run, config.seed, stage, told)
    export(student, run / "trunk.onnx")
    return run / "trunk.onnx"
