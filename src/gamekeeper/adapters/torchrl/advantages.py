"""Advantages over each agent's own decisions, and these decisions as a batch to learn from."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase

from gamekeeper.adapters.decisions import decided


def advantages(
    batch: TensorDictBase,
    groups: Iterable[str],
    *,
    gamma: float = 0.99,
    trace: float = 0.95,
    value: str = "state_value",
) -> TensorDictBase:
    """Writes `advantage`, `value_target` and `decided` into each group of a collected batch.

    A reward belongs to what its agent did last, whoever's step brought it. A value is bootstrapped
    where an agent was truncated, and not where it was terminated. Where everybody acts in every
    step this is TorchRL's own GAE.

    Args:
        batch: [copy, step] of `env` (or [step], of one copy), with `value` [..., agent, 1] in
            each group and in each group under `next`.
        groups: names of groups.
        gamma, trace: discount and lambda, per decision.
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
                after["reward"], own[value], own["mask"], own["done"], after["done"],
                after["terminated"], after[value], after["mask"],
            )
        ]  # fmt: skip
        rewards, values, acted, was_over, over, terminated, following, acting = read
        acted, over = acted.astype(bool), over.astype(bool)
        is_cut = over & ~terminated.astype(bool) & ~was_over.astype(bool)
        rewards = rewards + gamma * following * is_cut
        gained, known = decided(
            rewards, values, acted, over, following[-1], acting[-1].astype(bool),
            gamma=gamma, trace=trace,
        )  # fmt: skip
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
    """The decisions of a group's agents, one row each, [decision].

    Args:
        batch: what `advantages` returned.
        group: whose decisions.
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
