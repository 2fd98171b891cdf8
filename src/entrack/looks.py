"""Pictures of what the tracker saw: its features and its response map."""

from typing import cast

import cv2
import numpy as np

from entrack.datasets.frames import Image
from entrack.filter import Features


def heat(response: Features) -> Image:
    """A response map (n, n), about 0 to 1, as dark to light: (n, n) uint8.

    >>> heat(np.array([[-1, 0], [0.5, 2]], np.float32))
    array([[  0,   0], [128, 255]], dtype=uint8)
    """
    return np.round(255 * np.clip(response, 0, 1)).astype(np.uint8)


def coloured(heat: Image, size: int) -> Image:
    """A `heat` as a picture (size, size, 3) BGR, in a colour map that grey print keeps in order."""
    large = cv2.resize(heat, (size, size), interpolation=cv2.INTER_CUBIC)
    return cast(Image, cv2.applyColorMap(large, cv2.COLORMAP_INFERNO))


def principal(features: Features) -> Image:
    """Z (C, n, n) as a picture (n, n, 3): its three principal components, equal where Z is alike.

    Which component takes which colour, and its sign, mean nothing.
    """
    c, n, _ = features.shape
    points = features.reshape(c, -1).T
    points = points - points.mean(axis=0)
    axes = np.linalg.svd(points, full_matrices=False)[2][:3]
    axes *= np.sign(axes.sum(axis=1, keepdims=True))  # the same from frame to frame, mostly
    values = points @ axes.T
    low, high = np.percentile(values, [1, 99], axis=0)
    scaled: Features = np.clip((values - low) / np.maximum(high - low, 1e-9), 0, 1)
    return np.round(255 * scaled).astype(np.uint8).reshape(n, n, 3)
