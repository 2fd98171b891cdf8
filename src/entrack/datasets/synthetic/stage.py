"""From a configuration to a scene that shows what was asked for."""

import numpy as np
from numpy.random import Generator

from entrack.datasets.synthetic import moves
from entrack.datasets.synthetic.cast import Cast, Props, choose
from entrack.datasets.synthetic.config import HIDING, LEAD, RAMP, SyntheticConfig
from entrack.datasets.synthetic.moves import Event
from entrack.datasets.synthetic.scene import Scene
from entrack.errors import EntrackError

_TAKES = 40


def compose(config: SyntheticConfig, props: Props) -> Scene:
    """Plan a scene that shows what the configuration asks for.

    The same configuration and props give the same scene.

    Raises
    ------
    EntrackError
        Where the frames are too few or too small for what is to happen in them.
    """
    cast = choose(config, props)
    for take in range(_TAKES):
        rng = np.random.default_rng([config.seed, 1, take])
        events = _schedule(rng, config)
        scene = _direct(rng, config, props, cast, events)
        if scene is not None and _as_planned(scene, config, events):
            return scene
    raise EntrackError(
        f"found no way to show {', '.join(config.attributes)} in {config.length} frames of "
        f"{config.width} × {config.height} pixels with a target of {config.target_size:.0f} "
        "pixels; ask for less, or for more and larger frames"
    )


def _schedule(rng: Generator, config: SyntheticConfig) -> list[Event]:
    """Give every occlusion and exit a part of the sequence to itself."""
    frames = (2 if config.partial_occlusion else 0, config.full_occlusion, config.out_of_view)
    kinds = [pair for pair in zip(HIDING, frames, strict=True) if pair[1]]
    all_kinds = np.repeat(np.arange(len(kinds)), config.events)
    wanted = [kinds[int(index)] for index in rng.permutation(all_kinds)]
    if not wanted:
        return []
    hidden = 2 * LEAD + sum(count for _, count in wanted)
    ramp = (config.length - hidden) // (2 * len(wanted))
    if ramp < RAMP:
        raise EntrackError(
            f"{len(wanted)} occlusions and exits need {hidden + 2 * RAMP * len(wanted)} frames "
            f"or more, found {config.length}"
        )
    events: list[Event] = []
    begin = LEAD
    for kind, count in wanted:
        start = begin + ramp + int(rng.integers(-(ramp // 6), ramp // 6 + 1))
        end = begin + count + 2 * ramp
        events.append(Event(kind, start, start + count - 1, (begin, end)))
        begin = end
    return events


def _direct(
    rng: Generator, config: SyntheticConfig, props: Props, cast: Cast, events: list[Event]
) -> Scene | None:
    """One take; None where an occluder would have to be larger than the picture."""
    held = moves.pan(rng, config)
    target = moves.target(rng, config, events, cast.target, held)
    actors = [target, *(moves.lookalike(rng, config, c, target, held) for c in cast.lookalikes)]
    for event in events:
        if event.kind != "out_of_view":
            occluder = moves.occluder(rng, config, props, event, target)
            if occluder is None:
                return None
            actors.append(occluder)
    return Scene(
        config.width,
        config.height,
        cast.background,
        moves.trembling(rng, config, held),
        tuple(actors),
        target=0,
        light=moves.light(rng, config),
        shutter=config.motion_blur,
        detail=1 / config.low_resolution,
        noise=config.noise,
        seed=config.seed,
    )


def _as_planned(scene: Scene, config: SyntheticConfig, events: list[Event]) -> bool:
    """Whether the target is hidden when it should be, as long as it should be, and only then."""
    visible, gone = scene.visible, scene.absent.copy()
    if visible[:LEAD].min() < 0.95:
        return False
    for event in events:
        begin, end = event.slot
        if visible[min(end, len(visible) - 1)] < 0.6:
            return False
        if event.kind == "partial_occlusion":
            hidden = 1 - visible[begin:end].min()
            if abs(hidden - config.partial_occlusion) > 0.15:
                return False
        elif not gone[event.start : event.end + 1].all():
            return False
        else:
            count = event.end + 1 - event.start
            if gone[begin:end].sum() > 1.5 * count + 4:
                return False
            gone[begin:end] = False
    return not gone.any()
