"""Actors of TorchRL as policies, and advantages over each agent's own decisions.

A policy is for `gk.rollout`, `gk.evaluate` and evidence that names its version.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from gamekeeper.adapters.decisions import decided
from gamekeeper.adapters.requirements import not_learnt, weights_digest
from gamekeeper.adapters.torchrl import torchrl_specs as specs
from gamekeeper.adapters.torchrl.torchrl_agents import TorchRLAgents
from gamekeeper.adapters.torchrl.torchrl_env import TorchRLEnv
from gamekeeper.errors import PolicyError
from gamekeeper.interface.action_mask import reader
from gamekeeper.vector.sub_env_block import put_mask
from gamekeeper.vector.vector_form import getter, leaves

mask_of = reader(None)


def policy(
    actor: Any, env: TorchRLEnv, *, deterministic: bool = True, version: str | None = None
) -> ActorPolicy:
    """A policy of an actor whose agents each act on their own observation.

    Args:
        actor: reads `observation` (and `action_mask`) of a group, writes its `action`.
        env: the environment it was trained in; only its groups and specs are used.
        deterministic: takes the likeliest action; else one is drawn.
        version: kept with the evidence; None: the digest of its weights.
    Raises:
        PolicyError: when it is asked to play an agent that is in none of the groups.
    """
    if version is None:
        weights = sorted(actor.state_dict().items())
        version = weights_digest(pair for pair in weights if isinstance(pair[1], torch.Tensor))
    return ActorPolicy(actor, env, deterministic, version)


class ActorPolicy:
    """Use `policy`."""

    def __init__(self, actor: Any, env: TorchRLEnv, deterministic: bool, version: str) -> None:
        self.actor, self.version, self._deterministic = actor, version, deterministic
        self._group_of = {str(agent): each for each in env._learning for agent in each.agents}
        self._flat = env._is_flat
        self._blank = env.fake_tensordict().exclude("next").to("cpu")
        self._is_batched, self._groups = env._is_batched, env._copies.groups
        if self._is_batched:
            self._blank = self._blank[:1]

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent."""
        each = self._group_of.get(str(agent))
        if each is None:
            raise not_learnt(agent, self._group_of)
        place = [str(a) for a in each.agents].index(str(agent))
        given = self._blank.clone()
        row = given[0] if self._is_batched else given
        self._show(row[each.name], each, place, observation, info)
        kind = ExplorationType.DETERMINISTIC if self._deterministic else ExplorationType.RANDOM
        with torch.no_grad(), set_exploration_type(kind), torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(rng.integers(2**31)))
            acted = self.actor(given)
        action = (acted[0] if self._is_batched else acted)[each.name, "action"]
        return self._action(each, action, place)

    def _show(self, own: Any, each: TorchRLAgents, place: int, observation: Any, info: Any) -> None:
        space = self._groups[each.runs[0][0]].observation_space
        paths = [leaf.path for leaf in leaves(space, "observation_space")]
        arrays = [np.asarray(getter(paths[part.place])(observation)) for part in each.seen]
        if self._flat:
            one = [array[None, None] for array in arrays]
            own["observation"][place] = torch.from_numpy(
                specs.flat(each.seen, one, np.ones((1, 1), bool))[0, 0]
            )
        else:
            for part, array in zip(each.seen, arrays, strict=True):
                own.get(("observation", *part.key))[place] = specs.tensor(array.copy())
        own["mask"][place] = True
        if "action_mask" in own.keys():  # noqa: SIM118  # a TensorDict
            flags = np.empty(each.flags, np.int8)
            put_mask(flags, mask_of(observation, info))
            own["action_mask"][place] = torch.from_numpy(flags).bool()

    def _action(self, each: TorchRLAgents, action: Any, place: int) -> Any:
        if [part.key for part in each.done] != [()]:
            raise PolicyError(
                "actions of several tensors aren't played by an actor",
                where="policy",
                expected="Discrete, MultiDiscrete, MultiBinary or Box actions",
                actual=", ".join(".".join(part.key) for part in each.done),
                fix="flatten the actions, in the environment",
            )
        (part,) = each.done
        found = action[place].cpu().numpy() + getattr(part.space, "start", 0)
        return found.item() if found.ndim == 0 else found.astype(part.space.dtype)


def advantages(
    batch: TensorDictBase,
    groups: Iterable[str],
    *,
    gamma: float = 0.99,
    gae_lambda: float = 0.95,
    value: str = "state_value",
) -> TensorDictBase:
    """Writes `advantage`, `value_target` and `decided` into each group of a collected batch.

    A reward belongs to what its agent did last, whichever agent's step brought it. A value is
    bootstrapped where an agent was truncated, and not where it was terminated. Where all agents
    act in every step this is TorchRL's own GAE.

    Args:
        batch: [copy, step] of `env` (or [step], of one copy), with `value` [..., agent, 1] in
            each group and in each group under `next`.
        groups: names of groups.
        gamma, gae_lambda: discount and lambda, per decision.
        value: the key of the value estimates.
    Returns:
        The same batch. `decided` [..., agent] is False for steps in which the agent didn't act, and
        for a decision whose outcome lies beyond the batch.
    """
    is_one = batch.ndim == 1
    for group in groups:
        own, after = batch[group], batch["next", group]
        read = [
            _by_step(tensor, is_one=is_one)
            for tensor in (
                after["reward"],
                own[value],
                own["mask"],
                own["done"],
                after["done"],
                after["terminated"],
                after[value],
                after["mask"],
            )
        ]
        rewards, values, acted, was_over, over, terminated, following, acting = read
        acted, over = acted.astype(bool), over.astype(bool)
        is_cut = over & ~terminated.astype(bool) & ~was_over.astype(bool)
        rewards = rewards + gamma * following * is_cut
        gained, known = decided(
            rewards,
            values,
            acted,
            over,
            following[-1],
            acting[-1].astype(bool),
            gamma=gamma,
            gae_lambda=gae_lambda,
        )
        shape = own[value].shape
        for key, array in (("advantage", gained), ("value_target", gained + values)):
            batch[group, key] = _back(array, shape, own[value])
        batch[group, "decided"] = _back(known, shape[:-1], own[value]).bool()
    return batch


def _by_step(tensor: Any, *, is_one: bool) -> Any:
    """[copy, step, agent(, 1)] as [step, slot]."""
    array = tensor.detach().cpu().numpy()
    array = array[None] if is_one else array
    copies, steps, agents = array.shape[:3]
    return np.moveaxis(array.reshape(copies, steps, agents), 1, 0).reshape(steps, copies * agents)


def _back(array: Any, shape: Any, like: Any) -> Any:
    """[step, slot] in the shape of the batch."""
    agents = shape[-1] if len(shape) == len(like.shape) - 1 else shape[-2]
    whole = np.moveaxis(array.reshape(len(array), -1, agents), 0, 1)
    return torch.as_tensor(
        np.ascontiguousarray(whole), device=like.device, dtype=like.dtype
    ).reshape(shape)


def decisions(batch: TensorDictBase, group: str) -> TensorDictBase:
    """Returns the decisions of a group's agents, one row each, [decision].

    Args:
        batch: as `advantages` returned it.
        group: its name.
    Returns:
        The group's tensors under their own names (`observation`, `action`, `action_mask`,
        `advantage`, ...), `state` where there is one, and `place`, the number of the agent in the
        group, so that a network which all of them share learns from each by itself.
    """
    own = batch[group]
    rows = own.select(*own.keys()).clone(False)
    if "state" in batch.keys():  # noqa: SIM118  # of a TensorDict, `in` asks for something else
        lead = rows.batch_size
        state = batch["state"]
        rows["state"] = state.unsqueeze(len(lead) - 1).expand(*lead, *state.shape[len(lead) - 1 :])
    rows["place"] = torch.arange(rows.batch_size[-1], device=rows.device).expand(rows.batch_size)
    return rows[own["decided"]]
