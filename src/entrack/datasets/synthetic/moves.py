"""How the camera, the target and the others move, and how the light changes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from entrack.datasets.synthetic import motion
from entrack.datasets.synthetic.actor import Actor, around
from entrack.datasets.synthetic.cast import Props
from entrack.datasets.synthetic.config import SyntheticConfig
from entrack.datasets.synthetic.motion import Track
from entrack.datasets.synthetic.sprite import Sprite


@dataclass(frozen=True)
class Event:
    """Something that happens to the target from frame `start` to `end`, within `slot`."""

    kind: str
    start: int
    end: int
    slot: tuple[int, int]


def pan(rng: Generator, config: SyntheticConfig) -> Track:
    """The camera's track (T, 4), held by a steady hand."""
    track = np.tile([0.0, 0.0, 1.0, 0.0], (config.length, 1))
    if config.camera_motion:
        velocity = motion.spline(rng.standard_normal((4 + config.length // 30, 2)), config.length)
        velocity *= config.camera_motion * config.target_size / np.hypot(*velocity.T).mean()
        track[:, :2] = np.cumsum(velocity, axis=0)
        track[:, 2] = np.exp(0.1 * motion.wander(rng, config.length, 40))
        track[:, 3] = 0.06 * motion.wander(rng, config.length, 40)
    return track


def trembling(rng: Generator, config: SyntheticConfig, held: Track) -> Track:
    """The same in a hand that trembles as much as it moves."""
    amplitude = 0.15 * config.camera_motion * config.target_size
    tremor = motion.shake(rng, config.length, amplitude)
    return np.column_stack([held[:, :2] + tremor, held[:, 2:]])


def target(
    rng: Generator, config: SyntheticConfig, events: list[Event], thing: Sprite, held: Track
) -> Actor:
    """The target on a stroll through the picture, its size, angle and shape changing as asked."""
    length = config.length
    size = config.scale ** motion.wander(rng, length, 45)
    if config.target_size * size.max() > 0.75 * min(config.width, config.height):
        size = 1 / size
    turn = 2 * np.pi * config.rotation * motion.wander(rng, length, 50)
    turn += 0.04 * motion.wander(rng, length, 30)
    stretch = config.aspect_change ** motion.wander(rng, length, 45)
    scale = config.target_size / thing.size * size
    poses = np.column_stack([np.zeros((length, 2)), scale, stretch, turn])
    actor = Actor(thing, poses, _play(length, len(thing), 0), poses[:, 1])
    box = actor.extents  # around 0
    room = np.array([config.width, config.height])
    low = np.minimum(4 - box[:, :2].min(axis=0), room / 2)
    high = np.maximum(room - 4 - (box[:, :2] + box[:, 2:]).max(axis=0), room / 2)
    path = motion.stroll(rng, low, high, _steps(rng, config, config.target_size * size))
    for event in events:
        if event.kind == "out_of_view":
            path = _exit(config, event, path, box)
    poses = np.column_stack([_into_world(path, config, held), poses[:, 2:]])
    return replace(actor, poses=poses, layer=poses[:, 1])  # lower is nearer


def _steps(rng: Generator, config: SyntheticConfig, size: Track) -> Track:
    """Pixels that the target moves from each frame to the next, (T − 1,)."""
    count = config.length - 1
    pace = config.speed * np.exp(0.7 * motion.wander(rng, count, 25)) if count else np.zeros(0)
    if config.fast_motion:
        for part in np.array_split(np.arange(count), config.events):
            if len(part) > 8:
                middle = int(rng.integers(int(part[0]) + 4, int(part[-1]) - 3))
                burst = motion.ease(count, middle, middle, 4)
                pace = np.maximum(pace, config.fast_motion * burst)
    return pace * size[:-1]


def _exit(config: SyntheticConfig, event: Event, path: Track, box: Track) -> Track:
    """Lead the path out over the nearest side border for the event's frames, and back in."""
    during = box[event.start : event.end + 1]
    reach = np.abs(np.concatenate([during[:, 0], during[:, 0] + during[:, 2]])).max()
    margin = 2 + reach + (0.03 + 0.4 * config.camera_motion) * config.target_size
    middle = path[(event.start + event.end) // 2, 0]
    outside = -margin if middle < config.width / 2 else config.width + margin
    swift = abs(outside - middle) / (0.12 * config.target_size)  # the time that a brisk walk takes
    ramp = min(swift, event.start - event.slot[0], event.slot[1] - event.end)
    away = motion.ease(config.length, event.start, event.end, ramp)
    led = path.copy()
    led[:, 0] += away * (outside - path[:, 0])
    return led


def lookalike(
    rng: Generator, config: SyntheticConfig, thing: Sprite, target: Actor, held: Track
) -> Actor:
    """Something like the target that starts away from it and once comes close to it."""
    length, size = config.length, config.target_size
    room = np.array([config.width, config.height])
    margin = np.minimum(0.6 * size, room / 2)
    steps = _steps(rng, replace(config, fast_motion=0.0), np.full(length, size))
    goal = _into_picture(target.poses[:, :2], config, held)
    paths = [motion.stroll(rng, margin, room - margin, steps) for _ in range(8)]
    path = max(paths, key=lambda p: float(np.hypot(*(p[0] - goal[0]))))
    meeting = int(rng.integers(length // 3, max(length - length // 6, length // 3 + 1)))
    angle = rng.uniform(0, 2 * np.pi)
    beside = goal[meeting] + rng.uniform(0.8, 1.2) * size * np.array([np.cos(angle), np.sin(angle)])
    pull = motion.ease(length, meeting - 2, meeting + 2, max(length / 5, 1))
    path = path + pull[:, None] * (beside - path[meeting])
    poses = np.column_stack([_into_world(path, config, held), target.poses[:, 2:]])
    poses[:, 2] *= target.sprite.size / thing.size * np.exp(rng.normal(0, 0.05))
    poses[:, 4] += rng.normal(0, 0.15)
    pictures = _play(length, len(thing), int(rng.integers(len(thing))))
    return Actor(thing, poses, pictures, poses[:, 1])


def occluder(
    rng: Generator, config: SyntheticConfig, props: Props, event: Event, target: Actor
) -> Actor | None:
    """A thing that crosses before the target, just large enough for what it must hide.

    It goes straight ahead at a constant speed. Seen from it, the target's boxes during the event
    cover a rectangle: whatever the target's path, a thing of that size hides it. None where that
    is about the size of the picture.
    """
    time = np.arange(config.length)
    middle = (event.start + event.end) / 2
    during = slice(event.start, event.end + 1)
    boxes = target.extents
    centres = boxes[during, :2] + boxes[during, 2:] / 2
    size = float(np.sqrt(boxes[during, 2] * boxes[during, 3]).mean())
    count = len(centres)
    drift = (centres[-1] - centres[0]) / max(count - 1, 1)
    passing = min(size / 9, (0.4 * config.width - 0.5 * size) / count)
    velocity = drift + passing * np.array([rng.choice([-1, 1]), rng.uniform(-0.15, 0.15)])
    way = velocity * (time - middle)[:, None]
    low = (boxes[:, :2] - way)[during].min(axis=0)
    high = (boxes[:, :2] + boxes[:, 2:] - way)[during].max(axis=0)
    if event.kind == "full_occlusion":
        extent = 1.1 * (high - low) + 6
        if (extent > (0.85 * config.width, 1.2 * config.height)).any():
            return None
    else:  # a pole from top to bottom
        pole = _pole(target, round(middle), config.partial_occlusion)
        extent = np.array([pole, 2 * config.height])
    width, height = np.ceil(extent).astype(int).tolist()
    poses = np.column_stack(
        [(low + high) / 2 + way, np.ones((config.length, 2)), np.zeros(config.length)]
    )
    nearest = np.full(config.length, np.inf)
    return Actor(props.board(rng, width, height), poses, _play(config.length, 1, 0), nearest)


def _pole(target: Actor, t: int, share: float) -> int:
    """Width of the thinnest pole that hides a share of the target where it hides most."""
    world = np.eye(3)
    columns = target.alpha(t, world, around(target.box(t, world))).sum(axis=0)
    total = np.concatenate([[0.0], np.cumsum(columns)])
    wanted = share * float(total[-1])
    widths = range(1, len(total))
    return next(w for w in widths if float((total[w:] - total[:-w]).max()) >= wanted)


def light(rng: Generator, config: SyntheticConfig) -> Track:
    """(T, 4) gain, warmth and slopes of the light; it changes slowly, and once at a stroke."""
    length, change = config.length, config.illumination
    light = np.tile([1.0, 0.0, 0.0, 0.0], (length, 1))
    if not change:
        return light
    switch = rng.integers(length // 4, max(3 * length // 4, length // 4 + 1))
    step = np.where(np.arange(length) < switch, 0.0, rng.uniform(0.2, 0.4))
    dim = np.abs(motion.wander(rng, length, 40)) * (1 - step.max()) + step
    light[:, 0] = 1 - change * dim / max(dim.max(), 1e-9)
    light[:, 1] = 0.2 * change * motion.wander(rng, length, 60)
    for axis in (2, 3):
        light[:, axis] = 0.6 * change * motion.wander(rng, length, 50)
    return light


def _play(length: int, count: int, offset: int) -> NDArray[np.int64]:
    """Pictures of a film forwards and backwards again, for as long as needed."""
    loop = max(2 * (count - 1), 1)
    position = (np.arange(length) + offset) % loop
    return np.minimum(position, loop - position)


def _into_world(path: Track, config: SyntheticConfig, camera: Track) -> Track:
    """Points of the picture (T, 2) in the world."""
    middle = np.array([config.width, config.height]) / 2
    return camera[:, :2] + _turned(path - middle, -camera[:, 3]) / camera[:, 2:3]


def _into_picture(path: Track, config: SyntheticConfig, camera: Track) -> Track:
    """Points of the world (T, 2) in the picture."""
    middle = np.array([config.width, config.height]) / 2
    return middle + _turned(path - camera[:, :2], camera[:, 3]) * camera[:, 2:3]


def _turned(points: Track, angle: Track) -> Track:
    c, s = np.cos(angle), np.sin(angle)
    x, y = points.T
    return np.stack([c * x - s * y, s * x + c * y], axis=1)
