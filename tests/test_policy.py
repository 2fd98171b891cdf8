"""π(a | s): the numpy policy, and that it equals the one that is trained."""

from pathlib import Path

import numpy as np
import pytest

from entrack.box import moved
from entrack.config import Config, PolicyConfig, ScaleConfig
from entrack.errors import EntrackError
from entrack.policy import Gaussian, Policy, load_policy
from entrack.tracker import PLACES, Tracker
from test_tracker import Averages, scene

torch = pytest.importorskip("torch")
networks = pytest.importorskip("entrack.learn.networks")

RNG = np.random.default_rng(1)
CHANNELS = 7  # of the stand-in trunk


def untrained(f1: str, channels: int = CHANNELS, spread: float = 0.05, joint: bool = False):
    """A policy with random weights: numpy, torch actor and torch f1."""
    torch.manual_seed(3)
    config = PolicyConfig(f1=f1, reach=1.5)  # type: ignore[arg-type]
    if f1 == "linear":
        actor = networks.LinearActor(1.5, inputs=channels, joint=joint)
        return Policy(config, networks.weights_of(actor, None, None)), actor, None, None
    rng = np.random.default_rng(2)
    basis = networks.Basis(
        rng.normal(size=channels).astype(np.float32),
        rng.normal(size=(channels, 5)).astype(np.float32),
    )
    f1_, actor = networks.ConditionedF1(5, width=12), networks.AttentionActor(12, 1.5)
    torch.nn.init.normal_(actor.head.weight, std=spread)
    return Policy(config, networks.weights_of(actor, f1_, basis)), actor, f1_, basis


@pytest.mark.parametrize("joint", [False, True])
def test_numpy_equals_torch_for_the_papers_policy(joint: bool, tmp_path: Path):
    from safetensors.numpy import save_file

    _, actor, _, _ = untrained("linear", 256, joint=joint)
    path = tmp_path / "policy.safetensors"
    save_file(networks.weights_of(actor, None, None), path)
    policy = load_policy(path, PolicyConfig(f1="linear", reach=1.5))
    z = RNG.normal(size=(256, 18, 18)).astype(np.float32)
    m, last = RNG.random((18, 18)).astype(np.float32), np.full(4, 1 / 3, np.float32)
    state = policy.state(z, m, last, None)
    batch = networks.as_states({"z": z[None], "m": state.m[None], "held": last[None]})
    mean, log_std, _ = actor(batch)
    gaussian = policy(state)
    np.testing.assert_allclose(gaussian.mean, mean[0].detach().numpy(), atol=1e-4)
    np.testing.assert_allclose(gaussian.log_std, log_std[0].detach().numpy(), atol=1e-4)


def test_numpy_equals_torch_for_the_conditioned_policy():
    policy, actor, f1, basis = untrained("conditioned")
    first, z = RNG.normal(size=(2, CHANNELS, 18, 18)).astype(np.float32)
    roi = np.array([0.35, 0.3, 0.3, 0.4], np.float32)
    m, last = RNG.random((18, 18)).astype(np.float32), np.float32([0.3, 0.4, 0.1, -0.2])
    state = policy.state(z, m, last, policy.f1.remember(first, roi))

    from entrack.state import sample_grid

    def reduced(x):
        return np.tensordot(basis.vectors.numpy().T, x - basis.mean.numpy()[:, None, None], 1)

    inputs = (reduced(z), sample_grid(reduced(first), roi), m, last)
    tensors = [torch.from_numpy(np.float32(x)[None]) for x in inputs]
    with torch.no_grad():
        torch_z = f1(*tensors)
        batch = networks.States(torch_z, tensors[2].flatten(1), tensors[3])
        mean, log_std, _ = actor(batch)
    np.testing.assert_allclose(state.z, torch_z[0].numpy(), atol=1e-4)
    np.testing.assert_allclose(policy(state).mean, mean[0].numpy(), atol=1e-4)
    np.testing.assert_allclose(policy(state).log_std, log_std[0].numpy(), atol=1e-4)


def test_an_action_moves_the_sides_in_units_of_the_box():
    np.testing.assert_allclose(moved([10, 20, 40, 80], [0.5, 0, 0.25, -0.5]), [30, 20, 30, 40])
    # Eq. 7 with corners that cross: they are put in order (row 20).
    assert (moved([0, 0, 10, 10], [1.2, 0, 0, 0])[2:] > 0).all()


def test_sigma_and_entropy_are_those_of_the_samples():
    gaussian = Gaussian(np.array([0.2, -0.1, 0.5, 0.0]), np.log([0.05, 0.1, 0.02, 0.08]), 1.5)
    rng = np.random.default_rng(0)
    actions = np.array([gaussian.action(rng) for _ in range(20_000)])
    np.testing.assert_allclose(actions.std(0), gaussian.sigma, rtol=0.03)
    np.testing.assert_allclose(actions.mean(0), gaussian.action(), atol=0.005)
    expected = np.log(actions.std(0)).sum() + 2 * np.log(2 * np.pi * np.e)
    assert gaussian.entropy == pytest.approx(expected, abs=0.1)


def test_log_probability_has_the_change_of_variables():
    """exp(log π) over a fine grid of actions is a density: it adds up to one."""
    u = torch.linspace(-9, 9, 200_001, dtype=torch.float64)
    mean, log_std = torch.full((len(u), 1), 0.4), torch.full((len(u), 1), -0.7)
    noise = ((u[:, None] - mean) / log_std.exp()).double()
    action, log_pi = networks.squashed(mean.double(), log_std.double(), 1.5, noise)
    total = torch.trapezoid(log_pi.exp(), action[:, 0])
    assert total.item() == pytest.approx(1, abs=1e-4)


def test_the_tracker_takes_one_action_a_frame_and_says_how_sure_it_is():
    policy, *_ = untrained("conditioned")
    config = Config(scale=ScaleConfig(steps=1), policy=policy.config)
    tracker = Tracker(config, Averages(), policy)
    tracker.init(scene((100, 80)), (100, 80, 40, 40))
    estimate = tracker.update(scene((103, 80)))
    [state] = [tracker._targets[0].state]
    assert state is not None
    wanted = moved([100, 80, 40, 40], policy(state).action())
    centres = (estimate.box[:2] + estimate.box[2:] / 2, wanted[:2] + wanted[2:] / 2)
    np.testing.assert_allclose(*centres, atol=0.5 / PLACES)
    assert estimate.sigma is not None and estimate.sigma.shape == (4,)
    assert (estimate.sigma > 0).all()
    assert estimate.entropy == pytest.approx(policy(state).entropy)


def test_sampled_actions_differ_and_are_the_same_for_the_same_seed():
    def run(act: str, seed: int = 0):
        policy, *_ = untrained("conditioned")
        config = PolicyConfig(reach=1.5, act=act, seed=seed)  # type: ignore[arg-type]
        tracker = Tracker(Config(scale=ScaleConfig(steps=1), policy=config), Averages(), policy)
        tracker.init(scene((100, 80)), (100, 80, 40, 40))
        return np.array([tracker.update(scene((100 + k, 80))).box for k in range(3)])

    assert (run("sample") == run("sample")).all()
    assert (run("sample") != run("sample", seed=1)).any()
    assert (run("mean") != run("sample")).any()


def test_a_file_without_the_weights_is_one_sentence(tmp_path: Path):
    from safetensors.numpy import save_file

    save_file({"x": np.zeros(1, np.float32)}, tmp_path / "policy.safetensors")
    with pytest.raises(EntrackError, match="holds no linear policy"):
        load_policy(tmp_path / "policy.safetensors", PolicyConfig(f1="linear"))
    (tmp_path / "policy.safetensors").write_bytes(b"nonsense")
    with pytest.raises(EntrackError, match="holds no conditioned policy"):
        load_policy(tmp_path / "policy.safetensors", PolicyConfig())
