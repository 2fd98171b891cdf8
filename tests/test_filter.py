"""Eqs. 1–3 and 14 against slow loops and against what they are for."""

import numpy as np
import pytest

from entrack import filter as cf

RNG = np.random.default_rng(7)


def features(channels: int = 4, n: int = 6) -> np.ndarray:
    return RNG.normal(size=(channels, n, n)).astype(np.float32)


def test_label_is_a_gaussian_of_the_given_width_in_the_centre():
    y = cf.label(18, 1.5)
    assert np.unravel_index(y.argmax(), y.shape) == (9, 9)
    assert y[9, 9] == 1
    assert y[9, 12] == pytest.approx(np.exp(-9 / (2 * 1.5**2)), rel=1e-6)


def test_hann_is_one_in_the_centre_and_zero_at_the_first_edge():
    w = cf.hann(18)
    assert w[9, 9] == 1
    assert np.abs(w[0]).max() == 0
    np.testing.assert_allclose(w[1:], w[1:][::-1], atol=1e-7)


def test_fit_minimises_equation_1():
    """No small change of W lowers ‖W ⋆ X − Y‖² + λ‖W‖² (circular correlation, slow loops)."""
    x, y, lam = features(2, 4), cf.label(4, 0.7), 0.05
    x_hat = cf.spectrum(x)
    lam_absolute = lam * float((np.abs(x_hat) ** 2).sum(0).mean())
    w_hat = cf.fit(x_hat, cf.spectrum(y), lam)
    # M = F⁻¹(Ŵ ⊙ X̂) is a convolution with w = F⁻¹(Ŵ), summed over the channels.
    w = np.fft.irfft2(w_hat, s=(4, 4))

    def objective(w: np.ndarray) -> float:
        m = np.zeros((4, 4))
        for c, i, j, k, n in np.ndindex(2, 4, 4, 4, 4):
            m[i, j] += w[c, k, n] * x[c, (i - k) % 4, (j - n) % 4]
        # The spectrum of `fit` is unnormalised: λ there is λ here (Parseval on both terms).
        return float(((m - y) ** 2).sum() + lam_absolute * (w**2).sum())

    best = objective(w)
    for _ in range(30):
        assert objective(w + 1e-2 * RNG.normal(size=w.shape)) > best


def test_respond_is_the_sum_of_circular_convolutions():
    w, z = features(3, 5), features(3, 5)
    slow = np.zeros((5, 5))
    for c, i, j, k, n in np.ndindex(3, 5, 5, 5, 5):
        slow[i, j] += w[c, k, n] * z[c, (i - k) % 5, (j - n) % 5]
    np.testing.assert_allclose(cf.respond(cf.spectrum(w), cf.spectrum(z)), slow, atol=1e-4)


def test_template_answers_its_label_as_regularisation_vanishes():
    x, y = features(8, 18), cf.label(18, 0.6)
    weights = cf.fit(cf.spectrum(x), cf.spectrum(y), 1e-9)
    np.testing.assert_allclose(cf.respond(weights, cf.spectrum(x)), y, atol=1e-3)


@pytest.mark.parametrize("shift", [(0, 0), (2, -3), (-5, 4)])
def test_peak_follows_a_shifted_target(shift: tuple[int, int]):
    """The conjugated eq. 2 finds the shift; as printed it would not (PAPER: errata)."""
    x = features(16, 18)
    weights = cf.fit(cf.spectrum(x), cf.spectrum(cf.label(18, 0.6)), 0.01)
    moved = np.roll(x, shift, axis=(-2, -1))
    peak = cf.peak(cf.respond(weights, cf.spectrum(moved)))
    assert (peak.dy, peak.dx) == pytest.approx(shift, abs=0.05)
    assert peak.height > 0.8
    assert peak.psr > 10


def test_equation_2_as_printed_does_not_follow_the_target():
    found = 0
    for seed in range(20):
        x = np.random.default_rng(seed).normal(size=(32, 18, 18)).astype(np.float32)
        template, label = cf.spectrum(x), cf.spectrum(cf.label(18, 0.6))
        printed = cf.fit(template, label, 0.01).conj() * label / label.conj()  # Ŷ X̂ above
        moved = cf.spectrum(np.roll(x, (2, -3), axis=(-2, -1)))
        peak = cf.peak(cf.respond(printed, moved))
        found += (round(peak.dy), round(peak.dx)) == (2, -3)
    assert found < 10


def test_peak_is_found_between_cells():
    d = np.arange(18) - 9
    response = np.exp(-((d[:, None] + 2.3) ** 2 + (d[None, :] - 1.6) ** 2) / 2).astype(np.float32)
    peak = cf.peak(response)
    assert (peak.dy, peak.dx) == pytest.approx((-2.3, 1.6), abs=0.05)


def test_peak_of_a_flat_response_does_not_move_by_a_fraction():
    peak = cf.peak(np.zeros((18, 18), np.float32))
    assert np.isfinite(peak).all()


def test_update_is_the_running_mean_of_equation_14():
    x, seen = features(), features()
    np.testing.assert_allclose(cf.update(x, seen, 0.01), 0.99 * x + 0.01 * seen, atol=1e-6)


def test_everything_broadcasts_over_several_targets():
    x = RNG.normal(size=(3, 4, 6, 6)).astype(np.float32)
    y = cf.spectrum(cf.label(6, 0.6))
    together = cf.respond(cf.fit(cf.spectrum(x), y, 0.01), cf.spectrum(x))
    for one, response in zip(x, together, strict=True):
        alone = cf.respond(cf.fit(cf.spectrum(one), y, 0.01), cf.spectrum(one))
        np.testing.assert_allclose(response, alone, atol=1e-5)


def test_a_featureless_template_gives_a_finite_filter():
    x = np.zeros((4, 6, 6), np.float32)
    assert np.isfinite(cf.fit(cf.spectrum(x), cf.spectrum(cf.label(6, 0.6)), 0.0)).all()


SIZES = np.log(np.float32([1 / 1.1, 1, 1.1]))


@pytest.mark.parametrize("size", [0.93, 1.0, 1.07])
def test_the_size_is_found_between_those_looked_at(size: float):
    heights = np.exp(-((SIZES - np.log(size)) ** 2) / 0.1).astype(np.float32)
    found = cf.highest(heights, SIZES, cf.parabola(SIZES))
    assert found == pytest.approx(np.log(size), abs=1e-4)


@pytest.mark.parametrize(
    ("heights", "size"),
    [((0.1, 0.2, 0.9), 1.1), ((0.4, 0.5, 0.6), 1.1), ((0.9, 0.2, 0.1), 1 / 1.1)],
)
def test_no_size_is_found_beyond_those_looked_at(heights: tuple[float, ...], size: float):
    found = cf.highest(np.float32(heights), SIZES, cf.parabola(SIZES))
    assert found == pytest.approx(np.log(size), abs=1e-6)


def test_where_nothing_answers_the_size_stays():
    assert cf.highest(np.zeros(3, np.float32), SIZES, cf.parabola(SIZES)) == 0
