"""The environment, the replay buffer and soft actor-critic, on a trunk that needs no weights."""

import numpy as np
import pytest

from entrack.box import from_corners, iou
from entrack.config import Config, PolicyConfig, ScaleConfig
from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.tracker import Tracker
from test_tracker import Averages, scene

torch = pytest.importorskip("torch")
gymnasium = pytest.importorskip("gymnasium")

# ruff: noqa: E402
from entrack.learn.env import Clip, EpisodeConfig, TrackingEnv, play, reward, starts
from entrack.learn.networks import States
from entrack.learn.replay import Batch, Episode, Replay
from entrack.learn.sac import SAC, SACConfig
from test_policy import untrained


def tracker() -> Tracker:
    policy, *_ = untrained("conditioned")
    config = Config(scale=ScaleConfig(steps=1), policy=PolicyConfig(reach=1.5))
    return Tracker(config, Averages(), policy)


def clip(length: int = 24, absent: tuple[int, ...] = ()) -> Sequence:
    boxes = np.array([[80 + 2.0 * k, 80, 40, 40] for k in range(length)])
    flags = np.isin(np.arange(length), absent)
    boxes[flags] = np.nan
    frames = [scene((80 + 2.0 * k, 80)) for k in range(length)]
    return Sequence("clip", frames, boxes, flags)


WHOLE = EpisodeConfig(frames=(2, 100), whole=True)


def env(**changes: object) -> TrackingEnv:
    config = EpisodeConfig(frames=(6, 8), **changes)  # type: ignore[arg-type]
    return TrackingEnv([clip()], episode=config, make=tracker)


def test_reward_is_equation_8():
    assert reward(0.51, 0.5, -1) == 0.51
    assert reward(0.5, 0.5, -1) == -1
    assert reward(0.0, 0.0, 0.0) == 0


@pytest.mark.filterwarnings("ignore:.*Box observation space.*")
def test_the_environment_is_one_by_gymnasiums_own_check():
    from gymnasium.utils.env_checker import check_env

    check_env(env(), skip_render_check=True)


def test_it_is_registered():
    import entrack.learn

    assert entrack.learn.TrackingEnv is TrackingEnv
    made = gymnasium.make("entrack/Track-v0", data=[clip()], make=tracker)
    seen, info = made.reset(seed=1)
    assert seen.shape == made.observation_space.shape
    assert info["sequence"] == "clip"


def test_the_best_action_hits_the_true_box():
    game = Clip(tracker(), clip(), WHOLE, np.random.default_rng(0))
    for _ in range(5):
        gain, overlap, terminated, truncated = game.step(game.best)
        assert overlap == pytest.approx(1)
        assert gain == pytest.approx(1)
        assert not terminated and not truncated


def test_the_end_of_a_clip_is_a_truncation_and_a_lost_target_a_termination():
    whole = play_with(lambda game: game.best)
    assert whole == (False, True, 23)
    lost = play_with(lambda game: np.array([1.4, 1.4, 1.4, 1.4]))
    assert lost[:2] == (True, False)
    assert lost[2] < 23


def play_with(act) -> tuple[bool, bool, int]:
    game = Clip(tracker(), clip(), WHOLE, np.random.default_rng(0))
    steps, terminated, truncated = 0, False, False
    while not terminated and not truncated:
        _, _, terminated, truncated = game.step(act(game))
        steps += 1
    return terminated, truncated, steps


def test_absent_targets_are_neither_rewarded_nor_lost():
    game = Clip(tracker(), clip(absent=(3, 4)), WHOLE, np.random.default_rng(0))
    outcomes = [game.step(np.zeros(4)) for _ in range(5)]
    assert np.isnan(outcomes[2][1]) and outcomes[2][0] == 0
    assert not any(terminated for _, _, terminated, _ in outcomes)


def test_episodes_start_where_the_target_is():
    assert list(starts(clip(8, absent=(0, 3)), 2)) == [1, 4, 5, 6]
    with pytest.raises(EntrackError, match="no two frames on end"):
        Clip(tracker(), clip(6, absent=tuple(range(6))), WHOLE, np.random.default_rng(0))
    with pytest.raises(EntrackError, match="no two frames on end"):
        TrackingEnv([clip(6, absent=tuple(range(6)))], make=tracker)


def test_the_agent_sees_what_the_tracker_sees():
    """An episode played with the mean action gives the boxes of `Tracker.update`."""
    sequence, alone = clip(), tracker()
    alone.init(sequence.frames[0], sequence.boxes[0])
    overlaps = [
        float(iou(alone.update(frame).box, box))
        for frame, box in zip(sequence.frames[1:], sequence.boxes[1:], strict=True)
    ]
    config = EpisodeConfig(frames=(2, 100), whole=True, patience=1000)
    episode = play(tracker(), sequence, config, np.random.default_rng(0), sample=False)
    np.testing.assert_allclose(episode.iou, overlaps, atol=1e-6)


def fake(steps: int, mark: float, terminated: bool = False) -> Episode:
    rows = mark + np.arange(steps + 1, dtype=np.float32)
    return Episode(
        np.tile(rows[:, None, None, None], (1, 1, 2, 2)).astype(np.float16),
        np.tile(rows[:, None], (1, 4)),
        np.tile(rows[:, None], (1, 4)),
        np.tile(rows[:-1, None], (1, 4)),
        np.tile(rows[:-1, None], (1, 4)),
        rows[:-1],
        rows[:-1],
        terminated,
    )


def test_replay_keeps_states_beside_their_successors_and_forgets_the_oldest():
    replay = Replay(20)
    for mark in (100, 200, 300, 400):
        replay.add(fake(6, mark, terminated=mark == 300))
    batch = replay.draw(500, np.random.default_rng(0))
    now, after = (
        states.m[:, 0].numpy()[rows]
        for states, rows in ((batch.state, batch.now), (batch.after, batch.then))
    )
    assert len(batch.state.m) == len(set(now))  # each once
    np.testing.assert_array_equal(after, now + 1)
    np.testing.assert_array_equal(batch.reward, now)
    assert now.min() >= 101  # the first episode is mostly overwritten
    assert set(now[batch.terminated == 1]) == {305.0}
    assert len(replay) == len(set(now))


def test_a_buffer_filled_again_draws_the_same():
    long, short = Replay(20), Replay(20)
    for mark in (100, 200, 300, 400, 500):
        long.add(fake(6, mark))
    for mark in (300, 400, 500):  # all that is still in the other one, and a bit more
        short.add(fake(6, mark))
    a, b = (r.draw(50, np.random.default_rng(1)) for r in (long, short))
    kept = a.reward >= 300
    assert kept.any()
    np.testing.assert_array_equal(np.unique(b.reward), np.unique(b.reward[b.reward >= 300]))


def learner(**changes: object) -> tuple[SAC, Batch]:
    torch.manual_seed(0)
    _, actor, _, _ = untrained("conditioned")
    sac = SAC(actor, SACConfig(**changes))  # type: ignore[arg-type]
    rng = np.random.default_rng(0)

    def states() -> States:
        parts = rng.random((8, 12, 18, 18)), rng.random((8, 324)), rng.uniform(0.2, 0.4, (8, 4))
        return States(*(torch.from_numpy(p.astype(np.float32)) for p in parts))

    action = rng.uniform(-0.2, 0.2, (8, 4)).astype(np.float32)
    ends = (np.arange(8) % 4 == 0).astype(np.float32)
    gains = rng.random(8).astype(np.float32)
    rows = np.arange(8)
    return sac, Batch(states(), rows, action, action, gains, states(), rows, ends)


def test_the_critic_sees_states_as_the_policy_did_when_it_began():
    _, actor, _, _ = untrained("conditioned")
    sac = SAC(actor, SACConfig(batch=12))
    kept, plain = Replay(40, sac.see), Replay(40)
    rng = np.random.default_rng(0)
    z, m = rng.random((21, 12, 18, 18)), rng.random((21, 324))
    played = fake(20, 0)._replace(
        z=z.astype(np.float16), m=m.astype(np.float32), held=rng.uniform(0.2, 0.4, (21, 4))
    )
    played = played._replace(held=played.held.astype(np.float32))
    for replay in kept, plain:
        replay.add(played)
    given, whole = (replay.draw(12, np.random.default_rng(1)) for replay in (kept, plain))
    assert given.seen and given.after is None and whole.after and not whole.seen
    for told, states, rows in (
        (given.seen[0], whole.state, whole.now), (given.seen[1], whole.after, whole.then)
    ):  # fmt: skip
        np.testing.assert_allclose(told, actor.features(states).numpy()[rows], atol=1e-5)

    losses = [
        SAC(untrained("conditioned")[1], sac.config).update(batch, torch.zeros(12, 4), act=False)
        for batch in (given, whole)
    ]
    assert losses[0] == pytest.approx(losses[1], rel=1e-3, abs=1e-5)
    with torch.no_grad():
        actor.head.weight += 1
    np.testing.assert_array_equal(sac.see(whole.state)[whole.now][:3], given.seen[0][:3])


def test_policies_of_one_f1_share_what_is_compiled(tmp_path):
    from safetensors.numpy import save_file

    from entrack.learn.rollout import _policy

    config = PolicyConfig(f1="conditioned", reach=1.5)
    weights = untrained("conditioned")[0].weights
    heads = dict(weights) | {"head.bias": weights["head.bias"] + 1}
    others = dict(weights) | {"f1.mix.bias": weights["f1.mix.bias"] + 1}
    policies = []
    for number, these in enumerate((dict(weights), heads, others)):
        save_file(these, tmp_path / f"{number}.safetensors")
        policies.append(_policy(tmp_path / f"{number}.safetensors", config))
    first, again, other = policies
    assert first.f1 is again.f1 is not other.f1
    assert not np.array_equal(first.head.w["head.bias"], again.head.w["head.bias"])


def test_q_learns_equation_10_and_goal_v_follows_by_equation_13():
    sac, batch = learner(gamma=0.9, rho=0.99)
    s, after = sac.actor.features(batch.state), sac.actor.features(batch.after)
    with torch.no_grad():
        kappa = torch.from_numpy(batch.reward) + 0.9 * (1 - torch.from_numpy(batch.terminated)) * (
            sac.goal_v(after)
        )
        inputs = torch.cat([s, torch.from_numpy(batch.action)], 1)
        expected = sum(((q(inputs) - kappa) ** 2).mean().item() for q in sac.q)
    before = [p.clone() for p in sac.goal_v.parameters()]
    losses = sac.update(batch, torch.zeros(8, 4))
    assert losses["loss_q"] == pytest.approx(expected, rel=1e-4)
    for old, goal, v in zip(before, sac.goal_v.parameters(), sac.v.parameters(), strict=True):
        torch.testing.assert_close(goal, 0.99 * old + 0.01 * v)


def test_the_critic_of_the_paper_is_linear_with_its_dimensions():
    """§3.2.8: 5512 inputs of Q, 5508 of V."""
    _, actor, _, _ = untrained("linear", 256)
    sac = SAC(actor, SACConfig())
    assert [layer.in_features for layer in sac.q[0] if hasattr(layer, "in_features")] == [5512]
    assert [layer.in_features for layer in sac.v if hasattr(layer, "in_features")] == [5508]


def test_the_policy_goes_where_q_is_larger():
    """The sign of eq. 12: with Q = −|a − 0.3| the actions go to 0.3."""
    sac, batch = learner(alpha=0.0, actor_lr=1e-2)

    class Hill(torch.nn.Module):
        def forward(self, x):
            return -(x[:, -4:] - 0.3).abs().sum(1)

    sac.q = torch.nn.ModuleList([Hill(), Hill()])
    for _ in range(60):
        mean, *_ = sac.actor(batch.state)
        fresh = sac.actor.reach * torch.tanh(mean)
        loss = -sac.q[0](fresh).mean()
        sac.optimise_pi.zero_grad()
        loss.backward()
        sac.optimise_pi.step()
    assert (fresh - 0.3).abs().mean() < 0.1


def test_more_alpha_gives_more_entropy():
    def entropy(alpha: float) -> float:
        sac, batch = learner(alpha=alpha, actor_lr=1e-2)
        rng = np.random.default_rng(0)
        for _ in range(40):
            noise = torch.from_numpy(rng.standard_normal((8, 4)).astype(np.float32))
            values = sac.update(batch, noise)
        return values["entropy"]

    assert entropy(0.9) > entropy(0.0) + 0.5


def test_imitation_pulls_towards_the_best_action():
    sac, batch = learner(imitate=10.0, alpha=0.0, actor_lr=1e-2)
    best = from_corners([0, 0, 1, 1])  # any numbers
    batch = batch._replace(best=np.tile(np.float32(best * 0.1), (8, 1)))
    mean, *_ = sac.actor(batch.state)
    before = sac._imitation(mean, batch).item()
    for _ in range(30):
        sac.update(batch, torch.zeros(8, 4))
    mean, *_ = sac.actor(batch.state)
    assert sac._imitation(mean, batch).item() < 0.5 * before


def test_stable_baselines_can_train_in_it():
    sb3 = pytest.importorskip("stable_baselines3")
    agent = sb3.SAC(
        "MlpPolicy", env(), learning_starts=8, batch_size=8, buffer_size=64, seed=0,
        policy_kwargs={"net_arch": [16]},
    )  # fmt: skip
    agent.learn(24)
    action, _ = agent.predict(env().reset(seed=0)[0])
    assert action.shape == (4,)
