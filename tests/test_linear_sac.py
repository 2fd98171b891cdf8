"""The hand-written update of the paper's linear networks against autograd's."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

# ruff: noqa: E402
from entrack.learn.linear import LinearSAC, learner
from entrack.learn.networks import LinearActor
from entrack.learn.replay import Episode, Replay
from entrack.learn.sac import SAC, SACConfig
from entrack.trunks import checkpoint


def episode(steps: int, seed: int, terminated: bool) -> Episode:
    rng = np.random.default_rng(seed)
    count = steps + 1
    best = rng.uniform(-1.1, 1.1, (steps, 4)).astype(np.float32)  # some are out of reach
    best[0] = np.nan  # and there the target is absent
    return Episode(
        rng.random((count, 8, 18, 18)).astype(np.float16),
        rng.random((count, 5184)).astype(np.float32),
        rng.random((count, 4)).astype(np.float32),
        rng.uniform(-0.5, 0.5, (steps, 4)).astype(np.float32),
        best,
        rng.uniform(-1, 1, steps).astype(np.float32),
        np.zeros(steps, np.float32),
        terminated,
    )


def pair(config: SACConfig, joint: bool) -> list[SAC]:
    learners: list[SAC] = []
    for kind in (SAC, LinearSAC):
        torch.manual_seed(0)
        learners.append(kind(LinearActor(1.0, 8, joint=joint), config))
    return learners


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("policy_q", ["first", "smaller"])
@pytest.mark.parametrize(("steps", "imitate"), [(3, 0.0), (3, 2.0), (40, 0.0)])
def test_it_learns_what_autograd_learns(joint: bool, policy_q, steps: int, imitate: float):
    """From few states and from more than a batch shows, before and after a second episode."""
    config = SACConfig(batch=12, policy_q=policy_q, imitate=imitate)
    slow, fast = pair(config, joint)
    replay = Replay(100)
    for number in range(2):
        replay.clear()
        replay.add(episode(steps, number, terminated=number == 0))
        for step in range(6):  # Adam soon makes much of rounding
            a, b = (
                sac.learn(replay, np.random.default_rng([number, step])) for sac in (slow, fast)
            )
            assert a == pytest.approx(b, rel=1e-2, abs=2e-4)
            if number == step == 0:
                assert isinstance(fast, LinearSAC)
                for group, module in (fast._pi, slow.actor), (fast._v, slow.v):
                    for slope, p in zip(group.slopes, module.parameters(), strict=True):
                        np.testing.assert_allclose(slope, p.grad.numpy(), rtol=1e-3, atol=1e-5)
    for p, q in zip(slow.networks.parameters(), fast.networks.parameters(), strict=True):
        torch.testing.assert_close(p, q, rtol=2e-2, atol=2e-4)


def test_the_policy_stays_while_only_the_critic_learns():
    _, fast = pair(SACConfig(batch=12), joint=False)
    replay = Replay(20)
    replay.add(episode(5, 0, terminated=True))
    before = [p.detach().clone() for p in fast.actor.parameters()]
    critic = [p.detach().clone() for p in fast.q.parameters()]
    fast.learn(replay, np.random.default_rng(0), act=False)
    assert all(torch.equal(p, q) for p, q in zip(before, fast.actor.parameters(), strict=True))
    assert not any(torch.equal(p, q) for p, q in zip(critic, fast.q.parameters(), strict=True))


def test_it_goes_on_from_a_checkpoint_to_the_same_bits(tmp_path):
    config = SACConfig(batch=12)
    replay = Replay(20)
    replay.add(episode(5, 0, terminated=True))
    whole, begun, resumed = pair(config, False)[1], pair(config, False)[1], pair(config, False)[1]
    for step in range(6):
        whole.learn(replay, np.random.default_rng(step))
    for step in range(3):
        begun.learn(replay, np.random.default_rng(step))
    path = tmp_path / "state.safetensors"
    checkpoint.save(path, begun.networks, begun.optimisers, 3)
    assert checkpoint.load(path, resumed.networks, resumed.optimisers) == 3
    for step in range(3, 6):
        resumed.learn(replay, np.random.default_rng(step))
    for p, q in zip(whole.networks.parameters(), resumed.networks.parameters(), strict=True):
        assert torch.equal(p, q)


def test_it_is_for_linear_networks_only():
    actor = LinearActor(1.0, 8)
    assert isinstance(learner(actor, SACConfig()), LinearSAC)
    for other in SACConfig(hidden=(8,)), SACConfig(alpha_auto=True):
        assert not isinstance(learner(actor, other), LinearSAC)
