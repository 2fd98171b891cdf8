"""Soft actor-critic, eqs. 9–13: two Q functions, V, the goal value function, and the policy."""

from copy import deepcopy
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass
from torch import Tensor, nn

from entrack.learn.networks import Actor, States, perceptron, squashed
from entrack.learn.replay import Batch, Replay


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class SACConfig:
    """How the policy learns; Table 1 where the paper says it."""

    gamma: float = Field(default=0.99, ge=0, lt=1)
    """γ: discount."""
    alpha: float = Field(default=0.2, ge=0)
    """α: weight of the entropy (eq. 9)."""
    alpha_auto: bool = False
    """Adapt α so that the entropy stays at `target_entropy`."""
    target_entropy: float = -8.0
    """In nats, of the action in units of the box."""
    rho: float = Field(default=0.995, ge=0, lt=1)
    """ρ: how slowly the goal value function follows (eq. 13)."""
    hidden: tuple[int, ...] = ()
    """Hidden layers of Q and V; none is the paper's linear critic (row 11)."""
    lr: float = Field(default=1e-3, gt=0)
    """Adam's learning rate."""
    actor_lr: float = Field(default=1e-3, gt=0)
    """The same for the policy."""
    batch: int = Field(default=100, ge=1)
    """N_b."""
    policy_q: Literal["first", "smaller"] = "first"
    """The Q in the policy's loss: Q1 as in eq. 12, or min(Q1, Q2)."""
    imitate: float = Field(default=0.0, ge=0)
    """Weight of a loss that pulls the mean towards the action that hits the true box (row 23)."""


class SAC:
    """The critic and the actor, and one update of both."""

    def __init__(self, actor: Actor, config: SACConfig) -> None:
        self.config, self.actor = config, actor
        size = actor.features_size
        self.q = nn.ModuleList(perceptron(size + 4, config.hidden) for _ in range(2))
        self.v = perceptron(size, config.hidden)
        self.goal_v = deepcopy(self.v).requires_grad_(False)
        self.start = deepcopy(actor).requires_grad_(False)
        self.log_alpha = nn.Parameter(torch.tensor(float(np.log(max(config.alpha, 1e-8)))))
        self.optimise_q = torch.optim.Adam(self.q.parameters(), config.lr, fused=True)
        self.optimise_v = torch.optim.Adam(self.v.parameters(), config.lr, fused=True)
        self.optimise_pi = torch.optim.Adam(actor.parameters(), config.actor_lr, fused=True)
        self.optimise_alpha = torch.optim.Adam([self.log_alpha], 1e-3)

    @property
    def networks(self) -> nn.Module:
        """Everything that is learned, and the goal value function, to keep and to restore."""
        alpha = nn.ParameterList([self.log_alpha])
        return nn.ModuleList([self.actor, self.q, self.v, self.goal_v, alpha])

    @property
    def optimisers(self) -> dict[str, torch.optim.Optimizer]:
        """By name, likewise."""
        return {
            "q": self.optimise_q, "v": self.optimise_v,
            "pi": self.optimise_pi, "alpha": self.optimise_alpha,
        }  # fmt: skip

    def see(self, states: States) -> NDArray[np.float32]:
        """What the critic sees of states (N, k), by the eyes of the policy as it began.

        Once for every state and not in every update; nor does the critic's world change under it.
        """
        return self.start.features(states).numpy()

    def learn(self, replay: Replay, rng: np.random.Generator, act: bool = True) -> dict[str, float]:
        """One update on a batch of what is held; see `update`."""
        batch = replay.draw(self.config.batch, rng)
        noise = torch.from_numpy(rng.standard_normal((self.config.batch, 4)).astype(np.float32))
        return self.update(batch, noise, act)

    def update(self, batch: Batch, noise: Tensor, act: bool = True) -> dict[str, float]:
        """One step of eqs. 10–13 on `batch`; `noise` (N, 4) is the randomness of ã ~ π(· | s).

        Without `act` the policy stays as it is.
        """
        c = self.config
        alpha = self.log_alpha.exp().item() if c.alpha > 0 or c.alpha_auto else 0.0
        now = torch.from_numpy(batch.now)
        mean, log_std = (part[now] for part in self.actor.gaussian(batch.state))
        s, after = self._seen(batch)
        a, r = torch.from_numpy(batch.action), torch.from_numpy(batch.reward)
        p = torch.from_numpy(batch.terminated)
        fresh, log_pi = squashed(mean, log_std, self.actor.reach, noise)  # ã and log π(ã | s)

        # eq. 10: κq = r + γ (1 − p) V_ψ'(s')
        with torch.no_grad():
            kappa_q = r + c.gamma * (1 - p) * self.goal_v(after)
        loss_q = sum(
            (F.mse_loss(q(torch.cat([s, a], 1)), kappa_q) for q in self.q), torch.zeros(())
        )
        _step(self.optimise_q, loss_q)

        # eq. 11: κv = min_i Q_i(s, ã) − α log π(ã | s)
        self.q.requires_grad_(False)  # from here on Q is asked, and does not learn
        q_fresh = torch.stack([q(torch.cat([s, fresh], 1)) for q in self.q])
        self.q.requires_grad_(True)
        kappa_v = (q_fresh.amin(0) - alpha * log_pi).detach()
        loss_v = F.mse_loss(self.v(s), kappa_v)
        _step(self.optimise_v, loss_v)

        # eq. 12, whose sign is flipped in print: minimise α log π − Q
        value = q_fresh[0] if c.policy_q == "first" else q_fresh.amin(0)
        loss_pi = (alpha * log_pi - value).mean()
        if c.imitate:
            loss_pi = loss_pi + c.imitate * self._imitation(mean, batch)
        if act:
            _step(self.optimise_pi, loss_pi)
        if act and c.alpha_auto:
            gap = (log_pi.detach() + c.target_entropy).mean()
            _step(self.optimise_alpha, -self.log_alpha.exp() * gap)

        # eq. 13: ψ' ← ρ ψ' + (1 − ρ) ψ
        with torch.no_grad():
            for goal, v in zip(self.goal_v.parameters(), self.v.parameters(), strict=True):
                goal.lerp_(v, 1 - c.rho)
        return {
            "loss_q": loss_q.item(), "loss_v": loss_v.item(), "loss_pi": loss_pi.item(),
            "entropy": -log_pi.mean().item(), "alpha": alpha, "value": q_fresh.mean().item(),
        }  # fmt: skip

    def _seen(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """What the critic sees of s and s' (N, k)."""
        if batch.seen:
            s, after = batch.seen
            return torch.from_numpy(s), torch.from_numpy(after)
        assert batch.after is not None
        s, after = (self.actor.features(states) for states in (batch.state, batch.after))
        return s[torch.from_numpy(batch.now)], after[torch.from_numpy(batch.then)]

    def _imitation(self, mean: Tensor, batch: Batch) -> Tensor:
        """Huber distance of the mean action to the one that hits the true box, where known."""
        best = torch.from_numpy(batch.best)
        known = (best.abs() < self.actor.reach).all(1)
        action = self.actor.reach * torch.tanh(mean)
        return (
            F.smooth_l1_loss(action[known], best[known], beta=0.1)
            if known.any()
            else mean.sum() * 0
        )


def _step(optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
