"""The renderer: a background under a camera, actors upon it, and the target's exact boxes."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack.box import clip, iou
from entrack.datasets.frames import Image
from entrack.datasets.synthetic.actor import Actor, Matrix, around, at, draw, for_cv, shift
from entrack.datasets.synthetic.motion import Track

GONE = 0.02  # a target of which no more than this share shows is absent
_SMEAR = 1.5  # pixels of motion between two exposures that are averaged into a blurred frame
_EXPOSURES = 8


@dataclass(frozen=True)
class Scene:
    """Everything that a film is rendered from; no frame depends on another.

    Parameters
    ----------
    width, height
        Of the frames, in pixels.
    background
        (H, W, 3) uint8; mirrored where the camera looks beyond it.
    camera
        (T, 4): x, y of the world's point in the middle of the picture, zoom, roll in radians.
    actors
        All that moves.
    target
        Index of the actor that is tracked.
    light
        (T, 4): gain, warmth, and the gain's change from the middle to the right and lower border.
    shutter
        Share of a frame's time for which the shutter is open: motion blur.
    detail
        Sides of the sensor's pixels as a share of the frame's: below 1 the picture is soft.
    noise
        Deviation of the sensor's noise in grey levels.
    seed
        Of that noise.
    """

    width: int
    height: int
    background: Image
    camera: Track
    actors: tuple[Actor, ...]
    target: int
    light: Track
    shutter: float = 0.0
    detail: float = 1.0
    noise: float = 0.0
    seed: int = 0

    def __len__(self) -> int:
        return len(self.camera)

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """The target's boxes (T, 4), whole even where it is hidden or outside the picture."""
        return self.boxes_of(self.actors[self.target])

    def boxes_of(self, actor: Actor) -> NDArray[np.float64]:
        """Boxes (T, 4) of any actor."""
        return np.array([actor.box(t, self.view(t)) for t in range(len(self))])

    @cached_property
    def visible(self) -> NDArray[np.float64]:
        """Share of the target (T,) in [0, 1] that is in the picture and behind nothing."""
        boxes = [self.boxes_of(actor) for actor in self.actors]
        share = np.ones(len(self))
        for t, box in enumerate(self.boxes):
            inside = (clip(box, self.width, self.height) == box).all()
            order = self._order(t)
            before = order[order.index(self.target) + 1 :]
            covering = [self.actors[a] for a in before if iou(boxes[a][t], box) > 0]
            if covering or not inside:
                share[t] = self._visible(t, covering)
        return share

    @property
    def absent(self) -> NDArray[np.bool_]:
        """(T,) where the target is fully hidden or outside the picture."""
        return self.visible <= GONE

    def render(self, t: int) -> Image:
        """Frame `t`, BGR uint8 (height, width, 3)."""
        if not -len(self) <= t < len(self):
            raise IndexError(f"frame {t} of {len(self)}")
        t %= len(self)
        count = int(np.clip(np.ceil(self.shutter * self._speed[t] / _SMEAR), 1, _EXPOSURES))
        picture = self._expose(t) if count == 1 else self._blurred(t, count)
        return self._sense(self._lit(picture, t), t)

    def _expose(self, t: float) -> Image:
        """The world at one moment."""
        view = self.view(t)
        h, w = self.background.shape[:2]
        matrix = view @ shift(-w / 2, -h / 2)
        size = (self.width, self.height)
        canvas = cv2.warpAffine(
            self.background, for_cv(matrix), size, borderMode=cv2.BORDER_REFLECT_101
        )
        for index in self._order(round(t)):
            actor = self.actors[index]
            level, matrix = actor.drawing(t, view)
            draw(canvas, actor.sprite.pictures[int(actor.pictures[round(t)])][level], matrix)
        return canvas  # pyright: ignore[reportReturnType]

    def _order(self, t: int) -> list[int]:
        """Actors from the farthest to the nearest."""
        return sorted(range(len(self.actors)), key=lambda a: self.actors[a].layer[t])

    def _blurred(self, t: int, count: int) -> Image:
        total = np.zeros((self.height, self.width, 3), np.float32)
        for offset in self.shutter * (np.arange(count) / (count - 1) - 0.5):
            cv2.accumulate(self._expose(float(np.clip(t + offset, 0, len(self) - 1))), total)
        return (total * np.float32(1 / count) + np.float32(0.5)).astype(np.uint8)

    def _lit(self, picture: Image, t: int) -> Image:
        gain, warmth, across, down = self.light[t]
        if (gain, warmth, across, down) == (1, 0, 0, 0):
            return picture
        x = np.linspace(-across, across, self.width, dtype=np.float32)
        y = np.linspace(-down, down, self.height, dtype=np.float32)
        field = np.float32(gain) * (1 + y[:, None] + x)
        tinted = cv2.merge([field * np.float32(1 - warmth), field, field * np.float32(1 + warmth)])
        return cv2.multiply(picture, tinted, dtype=cv2.CV_8U)  # pyright: ignore

    def _sense(self, picture: Image, t: int) -> Image:
        """Fewer pixels, then noise: what the sensor does to the light."""
        if self.detail < 1:
            size = round(self.width * self.detail), round(self.height * self.detail)
            small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            picture = cv2.resize(small, (self.width, self.height))  # pyright: ignore
        if self.noise:
            x, y = 7919 * t % 61, 104729 * t % 53  # one sheet of noise, moved between frames
            part = self._sheet[y : y + self.height, x : x + self.width]
            picture = cv2.add(picture, part, dtype=cv2.CV_8U)  # pyright: ignore
        return picture

    @cached_property
    def _sheet(self) -> NDArray[np.int16]:
        size = (self.height + 53, self.width + 61, 3)
        noise = np.random.default_rng(self.seed).standard_normal(size, np.float32)
        return np.round(self.noise * noise).astype(np.int16)

    @cached_property
    def _speed(self) -> Track:
        """Largest distance in pixels that anything moves within frame t, (T,)."""
        span = np.clip(np.arange(len(self))[:, None] + (-0.5, 0.5), 0, len(self) - 1)
        moved = np.hypot(*np.diff([[at(self.camera, t)[:2] for t in s] for s in span], axis=1).T)
        for actor in self.actors:
            ends = np.array([[(self.view(t) @ actor.matrix(t))[:2, 2] for t in s] for s in span])
            moved = np.maximum(moved, np.hypot(*np.diff(ends, axis=1).T))
        return moved[0]

    def _visible(self, t: int, covering: list[Actor]) -> float:
        view, region = self.view(t), around(self.boxes[t])
        target = self.actors[self.target].alpha(t, view, region)
        shown = target.copy()
        for actor in covering:
            shown *= 1 - actor.alpha(t, view, region)
        x, y = region[0] + np.arange(region[2]), region[1] + np.arange(region[3])
        shown *= ((y >= 0) & (y < self.height))[:, None] & (x >= 0) & (x < self.width)
        return float(shown.sum() / target.sum())

    def view(self, t: float) -> Matrix:
        """From the world into the picture."""
        x, y, zoom, roll = at(self.camera, t)
        c, s = zoom * np.cos(roll), zoom * np.sin(roll)
        turn = np.array([[c, -s, self.width / 2], [s, c, self.height / 2], [0, 0, 1]])
        return turn @ shift(-x, -y)
