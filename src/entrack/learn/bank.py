"""The bank of looks for the warm start, made in chunks by workers and kept on disk."""

from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import entrack.filter as cf
from entrack.colour import Colours
from entrack.config import Config
from entrack.datasets.sequence import Sequence
from entrack.files import unfinished
from entrack.learn.config import BankConfig
from entrack.learn.store import kept
from entrack.state import sample_grid
from entrack.trunk import Trunk, load_trunk
from entrack.trunks.crops import Image, load_stills
from entrack.trunks.pairs import Pair, from_sequence, from_still

CHUNK = 500
KEYS = ("features", "points", "response", "box", "held")


@dataclass(frozen=True)
class Chunk:
    """`CHUNK` looks at most, by their number: the work of one unit."""

    index: int
    folder: Path
    """Where the bank is; `basis.npz` is there already."""
    clips: Path
    names: tuple[str, ...]
    """Annotated clips in `clips` …"""
    made: tuple[str, ...]
    """… and synthetic ones."""
    stills: Path | None
    trunk: Path
    tracker: Config
    config: BankConfig
    seed: int

    @property
    def path(self) -> Path:
        """The chunk's file."""
        return self.folder / f"{self.index:05d}.npz"

    @property
    def looks(self) -> int:
        """How many it has: the last one has what is left."""
        return min(CHUNK, self.config.looks - self.index * CHUNK)


class Source:
    """Draws pairs from clips, synthetic sequences and stills."""

    def __init__(self, chunk: Chunk) -> None:
        self.config, window = chunk.config, chunk.tracker.window
        self.distances = [replace(d, window=window) for d in (self.config.near, self.config.far)]
        self.clips = kept(chunk.clips, chunk.names)
        self.made = kept(chunk.clips, chunk.made)
        self.stills: list[Image] = load_stills(chunk.stills) if chunk.stills else []

    def draw(self, rng: np.random.Generator) -> Pair:
        """Draw one pair, half of them close and half far off."""
        c = self.config
        while True:
            kind, pair_config = rng.random(), self.distances[int(rng.random() >= 0.5)]
            if self.stills and kind < c.stills:
                return from_still(_any(self.stills, rng), self.stills, pair_config, rng)
            use_made = self.made and (not self.clips or kind < c.stills + c.made)
            source: list[Sequence] = self.made if use_made else self.clips
            pair = from_sequence(_any(source, rng), pair_config, rng)
            if pair is not None:
                return pair


def _any(items: SequenceOf[Any], rng: np.random.Generator) -> Any:
    return items[int(rng.integers(len(items)))]


@lru_cache(1)
def _tools(chunk: Chunk) -> tuple[Source, Trunk]:
    return Source(chunk), load_trunk(chunk.trunk, threads=1)


def tools(chunk: Chunk) -> tuple[Source, Trunk]:
    """What a worker needs for every chunk, opened once."""
    return _tools(replace(chunk, index=0))


def principal(chunk: Chunk, pairs: int = 400) -> None:
    """Find the components that the bank keeps: `basis.npz` with mean (C,) and vectors (C, k).

    Vectors are scaled alike, so that a component has a standard deviation of about ½ on average.
    """
    path = chunk.folder / "basis.npz"
    if path.exists():
        return
    chunk.folder.mkdir(parents=True, exist_ok=True)
    source, trunk = tools(chunk)
    rng = np.random.default_rng([chunk.seed, 3])
    cells: list[NDArray[np.float32]] = []
    for _ in range(min(pairs, chunk.config.looks)):
        pair = source.draw(rng)
        z = trunk(np.stack([pair.template, pair.search]))
        flat = z.transpose(0, 2, 3, 1).reshape(-1, z.shape[1])
        cells.append(flat[rng.integers(len(flat), size=60)])
    all_cells = np.concatenate(cells).astype(np.float64)
    mean = all_cells.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((all_cells - mean).T))
    kept_, spread = vectors[:, ::-1], np.sqrt(np.maximum(values[::-1], 0))
    k = min(chunk.config.components, len(spread))
    scaled = kept_[:, :k] * (0.5 / spread[:k].mean())
    with unfinished(path).open("wb") as file:
        np.savez(file, mean=mean.astype(np.float32), vectors=scaled.astype(np.float32))
    unfinished(path).replace(path)


def make_chunk(chunk: Chunk, report: Any = None) -> None:
    """Look at pairs as the tracker would, and write what it sees; skip what is there."""
    if chunk.path.exists():
        return
    source, trunk = tools(chunk)
    basis = np.load(chunk.folder / "basis.npz")
    mean, vectors = basis["mean"], basis["vectors"]
    config = chunk.tracker
    cells = config.window.size // 16
    taper = cf.hann(cells)
    label = cf.spectrum(cf.label(cells, config.filter.label_sigma * cells / config.window.context))
    columns: dict[str, list[NDArray[Any]]] = {key: [] for key in KEYS}
    for row in range(chunk.looks):
        pair = source.draw(np.random.default_rng([chunk.seed, 4, chunk.index, row]))
        template, search = trunk(np.stack([pair.template, pair.search]))
        weights = cf.fit(cf.spectrum(template * taper), label, config.filter.regularisation)
        response = cf.respond(weights, cf.spectrum(search * taper))
        if config.colour:
            colours = Colours.of(pair.template, pair.roi, config.colour)
            response = colours.weigh(response, pair.search, pair.held[:2])
        reduced = [np.tensordot(vectors.T, z - mean[:, None, None], 1) for z in (template, search)]
        points = sample_grid(reduced[0], pair.roi.astype(np.float32))
        found = (reduced[1], points, response, pair.box, pair.held)
        for key, value in zip(KEYS, found, strict=True):
            half = key in ("features", "points")
            columns[key].append(np.asarray(value, np.float16 if half else np.float32))
    with unfinished(chunk.path).open("wb") as file:
        np.savez(file, **{key: np.stack(values) for key, values in columns.items()})  # type: ignore[arg-type]
    unfinished(chunk.path).replace(chunk.path)


def load_bank(chunks: SequenceOf[Chunk]) -> dict[str, NDArray[Any]]:
    """Read all chunks into memory."""
    bank: dict[str, NDArray[Any]] = {}
    total, first = sum(chunk.looks for chunk in chunks), 0
    for chunk in chunks:
        with np.load(chunk.path) as part:
            for key in KEYS:
                rows = part[key]
                if key not in bank:
                    bank[key] = np.empty((total, *rows.shape[1:]), rows.dtype)
                bank[key][first : first + chunk.looks] = rows
        first += chunk.looks
    return bank
