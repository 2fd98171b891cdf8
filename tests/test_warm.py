"""The warm start: a linear policy, as the paper has it, learns from looks to follow a response."""

from pathlib import Path

import numpy as np
import pytest

from entrack.filter import label

pytest.importorskip("torch")

import torch

from entrack.learn.networks import Basis, LinearActor
from entrack.learn.warm import WarmConfig, evaluate, look, warm_start

CELLS, KEPT, CHANNELS = 18, 4, 6


def basis() -> Basis:
    """Orthogonal vectors of different lengths, and a mean."""
    rng = np.random.default_rng(0)
    vectors = np.linalg.qr(rng.normal(size=(CHANNELS, KEPT)))[0] * [2.0, 1.0, 0.7, 0.5]
    return Basis(rng.normal(size=CHANNELS).astype(np.float32), vectors.astype(np.float32))


def bank(count: int = 400) -> dict[str, np.ndarray]:
    """Targets of the held size, up to two cells off; the response says where, Z does not."""
    rng = np.random.default_rng(1)
    offset = rng.integers(-2, 3, (count, 2))
    response = np.stack([np.roll(label(CELLS, 1.0), (y, x), (0, 1)) for x, y in offset])
    third = np.full((count, 2), 1 / 3)
    corner = 0.5 - 1 / 6 + offset / CELLS
    return {
        "features": rng.normal(size=(count, KEPT, CELLS, CELLS)).astype(np.float16),
        "points": np.zeros((count, KEPT, 8, 8), np.float16),
        "response": response.astype(np.float32),
        "box": np.concatenate([corner, third], 1).astype(np.float32),
        "held": np.concatenate([third, np.zeros((count, 2))], 1).astype(np.float32),
    }


def test_a_linear_policy_sees_the_features_themselves_and_the_papers_m():
    looks, rows, known = bank(), np.arange(3), basis()
    states, box, held = look(known, looks, rows)
    kept = torch.einsum("ck,ncij->nkij", known.vectors, states.z - known.mean[:, None, None])
    np.testing.assert_allclose(kept, looks["features"][:3], atol=1e-2)
    assert states.m.shape == (3, 72 * 72) and box.shape == held.shape == (3, 4)


def test_a_linear_policy_of_z_and_m_learns_to_hit_the_target(tmp_path: Path):
    torch.manual_seed(0)
    looks, rows, config = bank(), np.arange(100), WarmConfig(steps=60, batch=64, lr=3e-3)
    actor = LinearActor(1.0, inputs=CHANNELS, joint=True)
    before = evaluate(basis(), actor, looks, rows, config)
    warm_start(basis(), actor, lambda: looks, config, tmp_path, seed=0)
    assert evaluate(basis(), actor, looks, rows, config) > max(0.8, before + 0.1)
    log = (tmp_path / "warm.csv").read_text().splitlines()
    assert log[0] == "step,loss,iou,iou_held_out" and log[-1].startswith("60,")
