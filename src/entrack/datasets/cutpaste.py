"""Cut things out of annotated clips and let them play before other pictures.

The cut-outs are sprites of `entrack.datasets.synthetic`: real things in their real motion, whose
boxes stay exact wherever they are pasted.

>>> from entrack.datasets.cutpaste import props
>>> from entrack.datasets.synthetic import sample, synthesise
>>> sequence = synthesise(sample(1), props("data"))  # doctest: +SKIP
"""

from collections.abc import Collection, Iterator
from collections.abc import Sequence as SequenceOf
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack.datasets.frames import Image, ImageFiles, VideoFrames, numbered_pictures
from entrack.datasets.synthetic import Props, Sprite, sprite
from entrack.errors import EntrackError

_LEAST = 12  # pixels of a side below which a cut-out is no use
_BRIEF = 8  # frames below which a film is no use


def props(
    data: Path | str, size: int = 128, longest: int = 40, without: Collection[str] = ()
) -> Props:
    """Cut-outs of every clip that has masks, and stills as backgrounds and occluders.

    Parameters
    ----------
    data
        A folder with `train/ID.mp4`, `masks/ID/%08d.png` and `images/*.jpg`.
    size
        Longest side of a cut-out, pixels.
    longest
        Pictures of a film at most: about 100 kB each.
    without
        Clips to leave alone, such as those of a validation split.

    Raises
    ------
    EntrackError
        Where the folder has no masks or no pictures.
    """
    data = Path(data)
    folders = (p for p in (data / "masks").glob("*") if p.is_dir())
    masks = sorted(p for p in folders if p.name not in without)
    stills = ImageFiles(sorted((data / "images").glob("*.jpg")))
    if not masks or not stills:
        raise EntrackError(f"{data} needs masks/ID/%08d.png and images/*.jpg for cut-and-paste")
    films = (cut_clip(data / "train" / f"{m.name}.mp4", m, size, longest) for m in masks)
    return Props(stills, stills, [film for film in films if film is not None])


def cut_clip(clip: Path, masks: Path, size: int = 128, longest: int = 40) -> Sprite | None:
    """Cut a thing out of a video; `masks` has a picture `%08d.png` a frame, counted from 1."""
    found = numbered_pictures(masks)
    frames = VideoFrames(clip, max(found, default=0))
    pairs = ((frames[number - 1], _read_mask(found[number])) for number in sorted(found))
    return cut(pairs, size, longest)


def cut(pairs: Iterator[tuple[Image, Image]], size: int = 128, longest: int = 40) -> Sprite | None:
    """Cut a thing out of frames (H, W, 3) by masks (H, W), nonzero where the thing is.

    The film is the longest run of frames that show the thing whole: clear of the border and not
    suddenly smaller, as it is behind something. None where there are fewer than eight.
    """
    run: list[tuple[Image, Image]] = []
    best = run
    for frame, mask in pairs:
        if not _is_whole(mask, run[-1][1] if run else None):
            run = []
            continue
        run.append((frame, mask))
        best = max(best, run, key=len)
        if len(best) >= longest:
            break
    return sprite(_film(best, size), shadow=0.25) if len(best) >= _BRIEF else None


def _film(run: SequenceOf[tuple[Image, Image]], size: int) -> NDArray[np.uint8]:
    """Pictures (N, h, w, 4) around the thing's smoothed way, at its smoothed size.

    What remains is its own motion; where it goes and how large it is is for the scene to say.
    """
    boxes = np.array([cv2.boundingRect(mask) for _, mask in run], np.float64)
    centres = boxes[:, :2] + boxes[:, 2:] / 2
    way = _smooth(centres)
    extent = _smooth(np.sqrt([[np.count_nonzero(mask)] for _, mask in run]))
    reach = ((boxes[:, 2:] / 2 + np.abs(centres - way) + 3) / extent).max(axis=0)
    scales = np.minimum(size / (2 * reach.max()), extent.max()) / extent[:, 0]
    half = reach * scales[0] * extent[0]
    w, h = np.ceil(2 * half).astype(int).tolist()
    film: list[Image] = []
    for (frame, mask), (x, y), scale in zip(run, way, scales, strict=True):
        x0, y0 = (max(int(v), 0) for v in np.floor((x, y) - half / scale))
        part = np.s_[y0 : int(y + half[1] / scale) + 2, x0 : int(x + half[0] / scale) + 2]
        move = np.array(
            [[scale, 0, w / 2 - scale * (x - x0)], [0, scale, h / 2 - scale * (y - y0)]]
        )
        move[:, 2] += 0.5 * scale - 0.5  # cv2 counts from pixels' centres
        # The outermost pixels are half background: leave them, and fade.
        alpha = cv2.erode(mask[part], np.ones((3, 3), np.uint8))
        picture = np.dstack([frame[part], cv2.GaussianBlur(alpha, (0, 0), 0.8)])
        if scale < 0.7:
            picture = cv2.GaussianBlur(picture, (0, 0), 0.4 / scale)
        film.append(cv2.warpAffine(picture, move, (w, h)))  # pyright: ignore[reportArgumentType]
    return np.stack(film)


def _smooth(track: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over eleven frames, going on straight beyond the ends, (T, D)."""
    padded = np.pad(track, ((5, 5), (0, 0)), mode="reflect", reflect_type="odd")
    return np.stack([np.convolve(column, np.ones(11) / 11, "valid") for column in padded.T], axis=1)


def _is_whole(mask: Image, before: Image | None) -> bool:
    x, y, w, h = cv2.boundingRect(mask)
    height, width = mask.shape
    if min(w, h) < _LEAST or x == 0 or y == 0 or x + w == width or y + h == height:
        return False
    area = np.count_nonzero(mask)
    largest = cv2.connectedComponentsWithStats(mask)[2][1:, cv2.CC_STAT_AREA].max()
    grown = 1.0 if before is None else area / np.count_nonzero(before)
    return largest > 0.93 * area and 0.75 < grown < 1.33


def _read_mask(path: Path) -> Image:
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if mask is None:
        raise EntrackError(f"mask {path} is not a picture that can be read")
    return ((mask > 0) * np.uint8(255)).astype(np.uint8)
