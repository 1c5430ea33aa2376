"""A policy of stable-baselines3 that scores each way of Corridors by the same small network.

The same things make each way good. A perceptron on the whole vector would have to learn them 13 times; this network
learns them once. The module imports torch and stable-baselines3: import it only where both are installed.
"""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from envs.drivers.corridors import AHEAD, HALF_FAN, OBSERVATION_SIZE, WAYS

WIDTH = 32  # channels of the network that scores the ways
VALUE_WIDTH = 64  # width of the critic
WAY_FEATURES = 6  # numbers from which a way is scored
INITIAL_WEIGHT = 0.1  # factor on a new network's scores, so that they do not outweigh the goal's direction
INITIAL_SPREAD = 2.0  # standard deviation, in ways, of a new policy's choices about the goal's direction


class WayScores(nn.Module):
    """Turns vectors of Corridors (n, 36) into a score of each way (n, 13) for the actor and features (n, 64) for the
    critic.

    A way's score depends on its own values and its neighbours', on its angles from the goal's direction, from the
    heading and from the last way, and on the distance of the goal.
    """

    def __init__(self) -> None:
        super().__init__()
        self.latent_dim_pi, self.latent_dim_vf = WAYS, VALUE_WIDTH
        self.offsets: torch.Tensor
        self.register_buffer("offsets", torch.linspace(HALF_FAN, -HALF_FAN, WAYS))
        self.score = nn.Sequential(
            nn.Conv1d(WAY_FEATURES, WIDTH, 3, padding=1, padding_mode="replicate"), nn.Tanh(),
            nn.Conv1d(WIDTH, WIDTH, 1), nn.Tanh(), nn.Conv1d(WIDTH, 1, 1),
        )  # fmt: skip
        self.value = nn.Sequential(
            nn.Linear(OBSERVATION_SIZE, VALUE_WIDTH), nn.Tanh(), nn.Linear(VALUE_WIDTH, VALUE_WIDTH), nn.Tanh()
        )

    def forward(self, vector: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return what the actor and the critic get: scores (n, 13) and features (n, 64) of vectors (n, 36)."""
        return self.forward_actor(vector), self.forward_critic(vector)

    def forward_actor(self, vector: torch.Tensor) -> torch.Tensor:
        """Return a score of each way, (n, 13), for vectors (n, 36)."""
        free, room, (share, sine, cosine), last = (
            vector[:, :WAYS], vector[:, WAYS : 2 * WAYS], vector[:, 2 * WAYS : 2 * WAYS + 3].T, vector[:, -1:],
        )  # fmt: skip
        bearing = self.offsets + torch.atan2(sine, cosine)[:, None]
        turn = torch.atan2(bearing.sin(), bearing.cos()).abs()
        beside = (self.offsets / HALF_FAN).abs().expand_as(free)
        moved = (self.offsets / HALF_FAN - last).abs()
        ways = torch.stack([free, room, beside, turn / HALF_FAN, moved, share[:, None].expand_as(free)], dim=1)
        return self.score(ways)[:, 0]

    def forward_critic(self, vector: torch.Tensor) -> torch.Tensor:
        """Return the features of the critic, (n, 64), for vectors (n, 36)."""
        return self.value(vector)


class WayPolicy(ActorCriticPolicy):
    """PPO's policy on WayScores.

    A new one drives at the goal and tries the ways beside it, so that it has only detours to learn.
    """

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor: Any = WayScores()

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        assert isinstance(self.action_net, nn.Linear)
        with torch.no_grad():
            self.action_net.weight.copy_(torch.eye(WAYS))
            self.action_net.bias.copy_(-0.5 * ((torch.arange(WAYS) - AHEAD) / INITIAL_SPREAD) ** 2)
            self.mlp_extractor.score[-1].weight.mul_(INITIAL_WEIGHT)
