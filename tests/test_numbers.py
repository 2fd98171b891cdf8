"""Numbers: none leaves the tracker that is none, and they are the same again, on any threads."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from reliability.targets import Means

import entrack
from entrack import box as boxes_
from entrack import filter as cf
from entrack.config import Config, WindowConfig
from entrack.model import assets, load_model
from entrack.policy import Policy, load_policy
from entrack.tracker import Estimate, Tracker
from entrack.video import open_source

NOISE = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
BOX = (30, 20, 20, 15)


def one_colour() -> np.ndarray:
    """A target of one colour on a ground of another."""
    image = np.full((60, 80, 3), (0, 160, 0), np.uint8)
    image[20:35, 30:50] = (0, 0, 200)
    return image


CONTENTS = {
    "black": np.zeros((60, 80, 3), np.uint8),
    "white": np.full((60, 80, 3), 255, np.uint8),
    "grey": np.full((60, 80, 3), 127, np.uint8),
    "noise": NOISE,
    "saturated": np.where(NOISE > 127, 255, 0).astype(np.uint8),
    "one colour": one_colour(),
}


def check(said: Estimate) -> None:
    """What the documentation promises of every estimate, in a picture of 80 × 60 pixels."""
    assert np.isfinite([*said.box, said.score, *said.search, said.ms]).all()
    assert said.sigma is None or (np.isfinite(said.sigma).all() and (said.sigma > 0).all())
    assert said.entropy is None or np.isfinite(said.entropy)
    assert 0 <= said.score <= 1
    x, y = said.box[:2] + said.box[2:] / 2
    assert 0 <= x <= 80 and 0 <= y <= 60
    assert (said.box[2:] <= [100, 75]).all() and (said.box[2:] >= [4 - 1e-9, 3 - 1e-9]).all()


@cache
def tracker(name: str) -> Tracker:
    return entrack.load(name, threads=1)


@pytest.mark.parametrize("name", ["default", "longterm", "cf", "cf-baseline"])
@pytest.mark.parametrize("content", CONTENTS)
def test_no_number_leaves_the_tracker_that_is_none(name: str, content: str) -> None:
    """In a picture that stands still, moves by a pixel, jumps, and becomes another one."""
    image = CONTENTS[content]
    frames = [image, np.roll(image, 1, 1), np.roll(image, (20, 41), (0, 1)), 255 - image, NOISE]
    tracker(name).init(image, BOX)
    for frame in frames:
        check(tracker(name).update(frame))


@pytest.mark.parametrize("name", ["default", "cf"])
def test_a_target_that_moves_by_a_pixel_is_followed(name: str) -> None:
    image = one_colour()
    tracker(name).init(image, BOX)
    for k in range(1, 9):
        said = tracker(name).update(np.roll(image, k, axis=1))
        check(said)
        assert boxes_.iou(said.box, (30 + k, 20, 20, 15)) > 0.5 and not said.lost


def test_a_template_of_zeros_has_a_finite_filter() -> None:
    nothing = cf.spectrum(np.zeros((3, 18, 18), np.float32))
    weights = cf.fit(nothing, cf.spectrum(cf.label(18, 1.8)), 0.01)
    assert np.isfinite(weights).all() and not cf.respond(weights, nothing).any()


def test_a_network_that_overflows_leaves_the_box_and_says_lost() -> None:
    class Broken(Means):
        broken = False

        def __call__(self, patches: np.ndarray) -> np.ndarray:
            features = super().__call__(patches)
            return features * np.float32("nan") if self.broken else features

    trunk = Broken()
    tracker = Tracker(Config(window=WindowConfig(size=64)), trunk)
    tracker.init(NOISE, BOX)
    trunk.broken = True
    said = tracker.update(NOISE)
    assert np.isfinite(said.box).all() and said.score == 0 and said.lost


def test_the_filter_in_single_precision_is_that_in_double() -> None:
    rng = np.random.default_rng(0)
    x, z = rng.standard_normal((2, 32, 18, 18))
    label = np.fft.rfft2(cf.label(18, 1.8).astype(np.float64))
    spectrum = np.fft.rfft2(x)
    energy = (np.abs(spectrum) ** 2).sum(0)
    weights = spectrum.conj() * label / (energy + 0.01 * energy.mean())
    exact = np.fft.irfft2((weights * np.fft.rfft2(z)).sum(0), s=(18, 18))
    single = [cf.spectrum(a.astype(np.float32)) for a in (x, z)]
    ours = cf.respond(cf.fit(single[0], label.astype(np.complex64), 0.01), single[1])
    np.testing.assert_allclose(ours, exact, atol=1e-5)


def test_the_shipped_policy_in_single_precision_is_that_in_double() -> None:
    """On features as the trunk makes them; boxes move by 0.001 of their size at most."""
    from safetensors.numpy import load_file

    from entrack.trunk import load_trunk

    model = load_model("default")
    assert model.policy is not None and model.config.policy is not None
    double = {name: w.astype(np.float64) for name, w in load_file(model.policy).items()}
    policies = load_policy(model.policy, model.config.policy), Policy(model.config.policy, double)
    rng = np.random.default_rng(0)
    size = model.config.window.size
    first, z = load_trunk(model.trunk, threads=1)(
        rng.integers(0, 256, (2, size, size, 3), np.uint8)
    )
    roi, held = np.array([0.3, 0.3, 0.4, 0.4]), np.array([0.4, 0.4, 0.1, -0.1])
    response = rng.random(z.shape[1:])
    said = []
    for policy, kind in zip(policies, (np.float32, np.float64), strict=True):
        known = policy.f1.remember(first.astype(kind), roi.astype(kind))
        state = policy.state(z.astype(kind), response.astype(kind), held.astype(kind), known)
        said.append(policy(state))
    moves = [np.tanh(gaussian.mean) * gaussian.reach for gaussian in said]
    np.testing.assert_allclose(moves[0], moves[1], atol=1e-3)
    np.testing.assert_allclose(said[0].log_std, said[1].log_std, atol=1e-3)


@pytest.mark.parametrize("name", ["default", "cf"])
def test_once_more_says_the_same_bits_and_two_threads_the_same_boxes(name: str) -> None:
    with open_source(assets() / "demo" / "clip.mp4", stop=6) as source:
        images = [frame.image for frame in source]
    said = []
    for threads in (1, 1, 2, 2):
        tracker = entrack.load(name, threads=threads)
        tracker.init(images[0], (148, 153, 102, 94))
        said.append(np.array([tracker.update(image).box for image in images[1:]]))
    np.testing.assert_array_equal(said[0], said[1])
    np.testing.assert_array_equal(said[2], said[3])
    for one, other in pairwise(said):
        np.testing.assert_allclose(one, other, atol=1e-3)
