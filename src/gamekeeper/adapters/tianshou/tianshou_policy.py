"""A trained algorithm as a policy for rollouts and evaluation, and networks that take masks."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from tianshou.data import Batch, to_numpy
from tianshou.utils.net.common import AbstractDiscreteActor, ModuleWithVectorOutput

from gamekeeper.adapters.requirements import not_learnt, weights_digest
from gamekeeper.adapters.slot_views import zeros
from gamekeeper.adapters.tianshou.tianshou_agents import native
from gamekeeper.adapters.tianshou.tianshou_envs import AgentsVectorEnv
from gamekeeper.errors import SpecError
from gamekeeper.interface.action_mask import reader

mask_of = reader(None)


def masked(actor: Any) -> MaskedNet:
    """An actor that never takes an action that its mask forbids; it gives logits, not shares.

    Tianshou's Q-learning policies look at masks themselves; its actors don't. Where the environment
    has no masks it is the actor as it was.

    Raises:
        SpecError: the actor ends in a softmax.
    """
    if getattr(actor, "softmax_output", False):
        raise SpecError(
            "shares can't be masked",
            where="actor",
            expected="logits",
            actual="softmax_output=True",
            fix="DiscreteActor(..., softmax_output=False)",
        )
    return MaskedNet(actor)


def unmasked(net: Any) -> Unmasked:
    """A critic (or any network) that is shown the bare observation, masked or not."""
    return Unmasked(net)


class MaskedNet(AbstractDiscreteActor):
    """Use `masked`."""

    def __init__(self, actor: Any) -> None:
        super().__init__(actor.get_output_dim())
        self.actor = actor

    def get_preprocess_net(self) -> Any:
        """Returns the actor's preprocessing network."""
        return self.actor.get_preprocess_net()

    def forward(self, obs: Any, state: Any = None, info: Any = None) -> Any:
        """Returns logits and hidden state; logits of masked actions are the least there is."""
        logits, hidden = self.actor(_bare(obs), state=state, info=info)
        if not _has(obs, "mask"):
            return logits, hidden
        legal = torch.as_tensor(obs.mask, device=logits.device).bool()
        return logits.masked_fill(~legal, torch.finfo(logits.dtype).min), hidden


class Unmasked(ModuleWithVectorOutput):
    """Use `unmasked`."""

    def __init__(self, net: Any) -> None:
        super().__init__(net.get_output_dim())
        self.net = net

    def forward(self, obs: Any, *args: Any, **kwargs: Any) -> Any:
        """Returns the network's output for the bare observation."""
        return self.net(_bare(obs), *args, **kwargs)


def _has(obs: Any, name: str) -> bool:
    return isinstance(obs, Batch) and name in obs.get_keys()


def _bare(obs: Any) -> Any:
    """The observation out of a row that also holds its mask or its agent's name."""
    return obs.obs if _has(obs, "mask") or _has(obs, "agent_id") else obs


def policy(
    algorithm: Any, env: AgentsVectorEnv, *, deterministic: bool = True, version: str | None = None
) -> LearntPolicy:
    """A policy for `gk.rollout` and wherever else one is taken.

    Args:
        algorithm: an algorithm or a policy of Tianshou's.
        env: the environment it learnt in: it has the form of observations.
        deterministic: takes the likeliest action; else one is drawn.
        version: kept with the evidence; None: the digest of the weights.
    """
    found = getattr(algorithm, "policy", algorithm)
    return LearntPolicy(
        found, env, deterministic, version or weights_digest(sorted(found.state_dict().items()))
    )


class LearntPolicy:
    """Use `policy`.

    Attributes:
        version: kept with the evidence.
    """

    def __init__(self, found: Any, env: AgentsVectorEnv, deterministic: bool, version: str) -> None:
        self._policy, self._env = found, env
        self._deterministic, self.version = deterministic, version

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent.

        Raises:
            PolicyError: it isn't among the agents that learnt.
        """
        slots, forms = self._env.slots, self._env.slots.forms
        names = [str(learner) for learner in slots.learners]
        if str(agent) not in names:
            raise not_learnt(agent, names)
        place = names.index(str(agent))
        number = slots.number_of(slots.learners[place])
        group: Any = slots.venv.groups[number]
        obs = zeros(forms.observation_space, (1,))
        forms.put(obs, (0,), number, observation)
        rows: Any = Batch(obs) if isinstance(obs, dict) else obs
        if forms.has_masks:
            rows = Batch(obs=rows, mask=self._mask(group, observation, info))
        mine = self._policy
        if self._env.is_multi:
            mine = mine.policies[str(self._env.named[place])]
        with torch.no_grad():
            act = to_numpy(self._chosen(mine, rows, rng))
        act = np.asarray(mine.map_action(act))[0]
        action = native(group.action_space, act)
        return int(action) if forms.actions else action

    def _chosen(self, mine: Any, rows: Any, rng: Any) -> Any:
        # `out.act` is left aside where there is a distribution: whether Tianshou draws it hangs on
        # `deterministic_eval`, and on whether its trainer was learning as it was last asked.
        given = Batch(obs=rows, info=Batch())
        if self._deterministic:
            out = mine(given)
            return out.act if out.get("dist") is None else out.dist.mode
        with torch.random.fork_rng(devices=range(torch.cuda.device_count())):  # a trainer's draws
            torch.manual_seed(int(rng.integers(2**31)))
            out = mine(given)
            return out.act if out.get("dist") is None else out.dist.sample()

    def _mask(self, group: Any, observation: Any, info: Any) -> Any:
        flags = np.zeros((1, self._env.slots.forms.actions), bool)
        given = mask_of(observation, info)
        flags[0, : group.action_space.n] = True if given is None else np.asarray(given) != 0
        return flags
