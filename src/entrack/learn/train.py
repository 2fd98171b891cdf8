"""`entrack train`: clips to disk, a bank of looks, the warm start, then rounds of SAC."""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

import entrack
from entrack.config import read
from entrack.errors import EntrackError
from entrack.evaluation.cluster import run_on_cluster
from entrack.evaluation.pool import NOTHING, Event, Pause, for_ever, run_units
from entrack.files import copy, write_bytes
from entrack.learn.bank import CHUNK, Chunk, load_bank, make_chunk, principal
from entrack.learn.config import TrainConfig
from entrack.learn.finish import finish
from entrack.learn.linear import learner
from entrack.learn.material import Source, gather
from entrack.learn.networks import (
    Actor,
    AttentionActor,
    Basis,
    ConditionedF1,
    LinearActor,
    weights_of,
)
from entrack.learn.replay import Episode, Replay
from entrack.learn.rollout import Rollout, read_episode, roll_out
from entrack.learn.store import kept
from entrack.learn.warm import warm_start
from entrack.model import Model, assets, save_model
from entrack.trunks import checkpoint

IN_VAIN = 10
"""So many episodes that failed on end are more than bad luck: the run stops."""

Report = Callable[[str, int, int, dict[str, float]], None]


def preset(name: str) -> TrainConfig:
    """A training configuration by its name, "paper" or "default", or from a TOML file."""
    shipped = assets().parent / "presets" / f"train-{name}.toml"
    return read(TrainConfig, shipped if shipped.is_file() else Path(name))


class Training:
    """A run folder and everything in it.

    RUN/config.json             what was asked for; another configuration is refused
    RUN/clips/                  frames as arrays
    RUN/bank/, RUN/warm.*       looks, and the warm start
    RUN/policies/               the policy of every round
    RUN/episodes/               episodes that the buffer still holds
    RUN/learner.safetensors     actor, critic and optimisers after the last round
    RUN/sac.csv, tensorboard/   the curves
    RUN/model/                  the model folder
    """

    def __init__(
        self,
        config: TrainConfig,
        base: Model,
        source: Source,
        run: Path,
        workers: int | None,
        resume: bool = False,
        report: Report = lambda stage, step, steps, values: None,
        cluster: str | None = None,
    ) -> None:
        """See `entrack.evaluation.cluster` for `cluster`; None plays in processes of this machine.

        All machines of a cluster have to see the run folder.
        """
        if config.tracker.policy is None:
            raise EntrackError(
                "the configuration has no [tracker.policy]: nothing would be learned"
            )
        checkpoint.claim(run, asdict(config), resume)
        torch.set_num_threads(config.threads)
        self.config, self.base, self.source, self.run = config, base, source, run
        self.workers, self.report, self.cluster = workers, report, cluster
        self.reach = config.tracker.policy.reach
        self.f1: ConditionedF1 | None = None
        self.basis: Basis | None = None
        self.actor: Actor
        self.failed: dict[str, str] = {}
        """Episodes and clips that could not be used, and why."""
        self._gathered = False
        self._in_vain = 0
        self._pause: float | None = None
        self._held: deque[tuple[Path, int]] = deque()

    def __call__(self) -> Path:
        """Train from where the run is to the end; return the model folder."""
        (self.run / "stop").unlink(missing_ok=True)
        self.gather()
        assert self.config.tracker.policy is not None
        torch.manual_seed(self.config.first_seed)
        if self.config.tracker.policy.f1 == "conditioned":
            self._warm()
        else:
            self.actor = LinearActor(self.reach, joint=self.config.joint)
            if self.config.warm:
                self._clone(*self._looks())
        torch.manual_seed(self.config.seed)
        self.learner = learner(self.actor, self.config.sac)
        self._learn()
        return self._ship()

    def gather(self) -> None:
        """Write the clips to disk, unless that is done; `failed` says what cannot be used."""
        if self._gathered:
            return
        self.names, self.made, self.checks = gather(
            self.source, self.config.data, self.run / "clips", self.failed,
            lambda step, steps: self.report("clips", step, steps, {}),
        )  # fmt: skip
        self._gathered = True

    # -- warm start ----------------------------------------------------------------------------

    def _warm(self) -> None:
        """A conditioned f1 and its head, learned from a bank if so configured."""
        c = self.config
        chunks, self.basis = self._looks()
        width = c.warm.width if c.warm else 64
        self.f1 = ConditionedF1(self.basis.vectors.shape[1], width=width)
        self.actor = AttentionActor(width, self.reach, c.tracker.window.size // 16)
        self._clone(chunks, self.f1)

    def _looks(self) -> tuple[list[Chunk], Basis]:
        """The bank, if there is a warm start, and the components of Z that it keeps."""
        c = self.config
        chunks = [
            Chunk(
                index, self.run / "bank", self.run / "clips", self.names, self.made,
                self.source.stills, self.base.trunk, c.tracker, c.bank, c.first_seed,
            )
            for index in range(-(-c.bank.looks // CHUNK))
        ]  # fmt: skip
        self._work("basis", _principal, chunks[:1])
        if c.warm:
            self._work("bank", make_chunk, chunks)
        with np.load(self.run / "bank" / "basis.npz") as basis:
            return chunks, Basis(basis["mean"], basis["vectors"])

    def _clone(self, chunks: list[Chunk], f1: ConditionedF1 | Basis) -> None:
        """Behaviour cloning from the bank; `f1` is the basis for a linear actor."""
        if self.config.warm:
            warm_start(
                f1, self.actor, partial(load_bank, chunks), self.config.warm, self.run,
                self.config.first_seed,
                lambda step, steps, values: self.report("warm start", step, steps, values),
            )  # fmt: skip

    def _hand_out(
        self, work: Callable[..., Any], units: list[Any], pause: Pause = for_ever
    ) -> Generator[Event]:
        """Have units done by processes of this machine, or on Ray."""
        if self.cluster is None:
            return run_units(work, units, self.workers or 2, pause=pause)
        return run_on_cluster(work, units, self.cluster, self.workers, pause=pause)

    def _work(self, stage: str, work: Callable[..., Any], units: list[Any]) -> None:
        """Have workers do units; a failed one is an error here."""
        done = 0
        with closing(self._hand_out(work, units)) as events:
            for event in events:
                if event.kind == "failed":
                    raise EntrackError(str(event.value).splitlines()[0])
                done += event.kind == "done"
                self.report(stage, done, len(units), {})

    # -- soft actor-critic ---------------------------------------------------------------------

    def _learn(self) -> None:
        """Rounds of episodes and updates, from the last checkpoint on."""
        c = self.config
        (self.run / "episodes").mkdir(exist_ok=True)
        (self.run / "policies").mkdir(exist_ok=True)
        path = self.run / "learner.safetensors"
        networks, optimisers = self.learner.networks, self.learner.optimisers
        first = checkpoint.load(path, networks, optimisers) if path.exists() else 0
        log = checkpoint.Log(self.run, "sac", first)
        # An f1 that is learned with the policy changes what the critic sees (paper, row 9).
        replay = Replay(c.capacity, self.learner.see if self.f1 else None)
        for past in range(0 if not c.fresh else first, first):
            self._take(past, replay)
        if not self._policy_path(first).exists():
            self._write_policy(first)
        last = self._checks(c.rounds)
        units = [unit for number in range(first, c.rounds) for unit in self._round(number)] + last
        try:
            with closing(self._hand_out(roll_out, units, lambda: self._pause)) as events:
                arrived: set[int] = set()

                def hand_out() -> None:
                    self._hear(next(events, NOTHING), units, arrived)

                for number in range(first, c.rounds):
                    wanted = {unit.number for unit in self._round(number)}
                    self._await(events, units, arrived, wanted)
                    values = self._round_done(number, replay, hand_out)
                    self._write_policy(number + 1)
                    log.write(number + 1, values)  # first: a row too many is dropped on resuming
                    checkpoint.save(path, networks, optimisers, number + 1)
                    self._forget(number)
                    self.report("policy", number + 1, c.rounds, values)
                self._await(events, units, arrived, {unit.number for unit in last})
        except BaseException:
            (self.run / "stop").touch()
            raise

    def _policy_path(self, number: int) -> Path:
        return self.run / "policies" / f"{number:05d}.safetensors"

    def _write_policy(self, number: int) -> None:
        """The policy after so many rounds, for the workers."""
        from safetensors.numpy import save as in_bytes

        weights = weights_of(self.actor, self.f1, self.basis)
        write_bytes(self._policy_path(number), in_bytes(weights))

    def _round(self, number: int) -> list[Rollout]:
        """The episodes of a round, and every so often looks at the validation clips."""
        c = self.config
        base = number * 10_000
        units: list[Rollout] = []
        for k in range(c.episodes):
            rng = np.random.default_rng([c.seed, 5, number, k])
            use_made = self.made and (not self.names or rng.random() < c.data.made_share)
            names = self.made if use_made else self.names
            policy = max(0, number - c.lag)
            units.append(self._unit(base + k, policy, names, (c.seed, 6, number, k)))
        if number % c.check_every == 0:
            units += self._checks(number)
        return units

    def _checks(self, number: int) -> list[Rollout]:
        """Every validation clip from its middle, with the mean action."""
        c = self.config
        policy = max(0, number - c.lag) if number < c.rounds else number
        episode = replace(
            c.episode, frames=(60, 60), whole=False, stride=1, jitter=0.0, patience=1000, oracle=0.0
        )
        return [
            replace(
                self._unit(number * 10_000 + 5_000 + k, policy, (name,), (7, k)),
                episode=episode, sample=False,
            )
            for k, name in enumerate(self.checks)
        ]  # fmt: skip

    def _unit(
        self, number: int, policy: int, names: tuple[str, ...], seed: tuple[int, ...]
    ) -> Rollout:
        c = self.config
        return Rollout(
            number, self.run / "episodes" / f"{number:09d}.npz", self._policy_path(policy),
            self.run / "stop", self.run / "clips", names, self.base.trunk, c.tracker, c.episode,
            seed, features=isinstance(self.actor, LinearActor),
        )  # fmt: skip

    def _await(
        self, events: Iterator[Event], units: list[Rollout], arrived: set[int], wanted: set[int]
    ) -> None:
        """Wait until the workers are through with some units."""
        self._pause = None
        while not wanted <= arrived:
            self._hear(next(events), units, arrived)
        self._pause = 0

    def _hear(self, event: Event, units: list[Rollout], arrived: set[int]) -> None:
        """Note which unit the workers are through with, and whether it failed."""
        if event.kind not in ("done", "failed"):
            return
        unit: Rollout = units[event.unit]
        arrived.add(unit.number)
        if event.kind == "failed":
            why = self.failed[unit.path.stem] = str(event.value).splitlines()[0]
            self._in_vain += 1
            if self._in_vain == IN_VAIN:
                raise EntrackError(f"{IN_VAIN} episodes in a row failed: {why}")
            return
        self._in_vain = 0
        if not unit.path.exists():
            raise EntrackError(
                f"an episode was played but is not in {unit.path.parent}: "
                "do all machines see this folder?"
            )

    def _round_done(
        self, number: int, replay: Replay, between: Callable[[], None]
    ) -> dict[str, float]:
        """Take in a round's episodes, and update; `between` is called after each update."""
        c = self.config
        if c.fresh:
            replay.clear()
        played, checked = self._take(number, replay)
        values: dict[str, float] = {"failed": float(len(self.failed))}
        if played:
            values |= {
                "return": float(np.mean([e.reward.sum() for e in played])),
                "iou": float(np.nanmean(np.concatenate([e.iou for e in played]))),
                "lost": float(np.mean([e.terminated for e in played])),
                "steps": float(np.mean([len(e.reward) for e in played])),
            }
        values["iou_validation"] = mean_iou(checked)
        losses: list[dict[str, float]] = []
        rng = np.random.default_rng([c.seed, 8, number])
        for _ in range(c.updates if len(replay) else 0):
            losses.append(self.learner.learn(replay, rng, act=number >= c.critic_first))
            between()
        if losses:
            values |= {k: float(np.mean([loss[k] for loss in losses])) for k in losses[0]}
        return values

    def _take(self, number: int, replay: Replay) -> tuple[list[Episode], list[Episode]]:
        """Put a round's episodes into the buffer; return them, and those of validation clips."""
        played: list[Episode] = []
        checked: list[Episode] = []
        for unit in self._round(number):
            if not unit.path.exists():
                continue  # it failed, which is noted, or it is long forgotten
            episode = read_episode(unit.path)
            if unit.sample:
                replay.add(episode)
                played.append(episode)
                self._held.append((unit.path, len(episode.reward) + 1))
            else:
                checked.append(episode)
        return played, checked

    def _forget(self, number: int) -> None:
        """Delete the episodes that the buffer no longer holds, and policies that nobody plays."""
        room = 0 if self.config.fresh else self.config.capacity
        states = sum(count for _, count in self._held)
        while self._held and states - self._held[0][1] >= room:
            path, count = self._held.popleft()
            path.unlink(missing_ok=True)
            states -= count
        for old in range(max(0, number - 3), number - 1):
            if old % self.config.check_every:
                self._policy_path(old).unlink(missing_ok=True)

    def validation(self) -> dict[str, NDArray[np.float32]]:
        """Overlaps with the true box in the validation clips, in the end; NaN where it is absent.

        An empty dictionary where there are no such clips.
        """
        units = zip(self.checks, self._checks(self.config.rounds), strict=True)
        return {name: read_episode(unit.path).iou for name, unit in units if unit.path.exists()}

    # -- the end -------------------------------------------------------------------------------

    def _ship(self) -> Path:
        """Write the model folder."""
        folder = self.run / "model"
        folder.mkdir(exist_ok=True)
        copy(self.base.trunk, folder / "trunk.onnx")
        copy(self._policy_path(self.config.rounds), folder / "policy.safetensors")
        text = "Filter, state and a policy learned by maximum-entropy reinforcement learning."
        files = folder / "trunk.onnx", folder / "policy.safetensors"
        save_model(folder, self.config.name, text, self.config.tracker, *files)
        if self.config.finish:
            self.report("score", 0, 1, {})
            tracker, clips = entrack.load(folder), kept(self.run / "clips", self.checks)
            try:
                config = finish(tracker, clips, self.config.finish)
                save_model(folder, self.config.name, text, config, *files)
            except EntrackError as error:
                self.failed["score"] = str(error)
            self.report("score", 1, 1, {})
        return folder


def _principal(chunk: Chunk, report: Any) -> None:
    principal(chunk)


def mean_iou(episodes: Sequence[Episode]) -> float:
    """Mean of the episodes' mean overlaps; NaN for none."""
    return float(np.mean([np.nanmean(e.iou) for e in episodes])) if episodes else float("nan")


def shortened(failed: Mapping[str, str], most: int = 5) -> str:
    """What was left out, and why, for people: the first few, and how many more."""
    listed = [f"{name} ({why})" for name, why in failed.items()]
    rest = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(listed[:most]) + rest
