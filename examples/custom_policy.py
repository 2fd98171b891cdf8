"""A policy of your own in the environment: python examples/custom_policy.py [FORMAT:DIR].

It moves the box to where the correlation filter answers most, and is compared with one that never
moves. The environment steps the tracker itself, so what works here works in a video.
"""

import sys

import gymnasium
import numpy as np

import entrack.learn  # noqa: F401  (registers the environment)
from entrack.model import assets

data = sys.argv[1] if len(sys.argv) > 1 else f"folder:{assets() / 'demo'}"
env = gymnasium.make("entrack/Track-v0", data=data, model="policy")
REACH = env.unwrapped.reach  # box sizes that an action of 1 moves a side
SIDE = 18  # cells of the response map


def follow_the_peak(seen: np.ndarray) -> np.ndarray:
    """Read M and the box's share of the window from the observation; move all sides alike."""
    response = seen[-4 - SIDE**2 : -4].reshape(SIDE, SIDE)
    share = seen[-4:-2]
    row, column = np.unravel_index(response.argmax(), response.shape)
    x, y = (np.array([column, row]) - SIDE // 2) / SIDE / share
    return np.clip(np.array([x, y, x, y], np.float32) / REACH, -1, 1)


def stay(seen: np.ndarray) -> np.ndarray:
    """Leave the box where it is."""
    return np.zeros(4, np.float32)


for policy in (follow_the_peak, stay):
    rewards, overlaps = 0.0, []
    for episode in range(3):
        seen, _ = env.reset(seed=episode)
        over = False
        while not over:
            seen, reward, terminated, truncated, info = env.step(policy(seen))
            rewards += reward
            overlaps.append(info["iou"])
            over = terminated or truncated
    steps, mean = len(overlaps), np.nanmean(overlaps)
    print(f"{policy.__name__}: reward {rewards:.1f} in {steps} steps, mean IoU {mean:.3f}")
