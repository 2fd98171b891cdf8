"""The compiled f1 says what its numpy reference says."""

import numpy as np
import pytest

from entrack.config import PolicyConfig
from entrack.fast import CompiledConditioned
from entrack.model import load_model
from entrack.policy import load_policy
from entrack.state import Conditioned

RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def both() -> tuple[CompiledConditioned, Conditioned]:
    """The f1 of the shipped policy, compiled and in numpy."""
    path = load_model("policy").policy
    assert path is not None
    compiled = load_policy(path, PolicyConfig()).f1
    assert isinstance(compiled, CompiledConditioned)
    return compiled, Conditioned({f"f1.{name}": w for name, w in compiled.w.items()})


def frame(n: int):
    """Features, response, last box, and what is in the middle of the first frame."""
    z = np.maximum(RNG.normal(size=(256, n, n)), 0).astype(np.float32)
    m = (0.1 * RNG.normal(size=(n, n))).astype(np.float32)
    return z, m, np.float32([0.3, 0.4, 0.1, -0.2])


@pytest.mark.parametrize("n", [18, 14])
def test_compiled_equals_numpy(both: tuple[CompiledConditioned, Conditioned], n: int):
    compiled, reference = both
    roi = np.float32([0.35, 0.3, 0.3, 0.4])
    for _ in range(2):  # another target and frame the second time
        target = reference.remember(frame(n)[0], roi)
        z, m, last = frame(n)
        expected = reference(z, m, last, target)
        np.testing.assert_allclose(compiled(z, m, last, target), expected, atol=1e-4, rtol=1e-4)


def test_a_cell_without_features_is_no_division_by_zero(
    both: tuple[CompiledConditioned, Conditioned],
):
    compiled, reference = both
    z, m, last = frame(18)
    target = reference.remember(z, np.float32([0.3, 0.3, 0.3, 0.3]))
    nothing = np.zeros_like(z)
    expected = reference(nothing, m, last, target)
    np.testing.assert_allclose(compiled(nothing, m, last, target), expected, atol=1e-4, rtol=1e-4)


def test_results_are_kept_when_the_next_frame_comes(
    both: tuple[CompiledConditioned, Conditioned],
):
    compiled, reference = both
    target = reference.remember(frame(18)[0], np.float32([0.3, 0.3, 0.3, 0.3]))
    first = compiled(*frame(18), target)
    before = first.copy()
    compiled(*frame(18), target)
    np.testing.assert_array_equal(first, before)
