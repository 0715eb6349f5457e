"""Copies of a multi-agent environment for Tianshou's collectors and multi-agent algorithms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from tianshou.data import Batch

from gamekeeper.adapters.checked import checked
from gamekeeper.adapters.tianshou.seats import Seats
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.cast import Choices

SHARES: Final = ("one", "role", "agent")


def vector_env(
    spec: object,
    num_envs: int,
    *,
    role: str | None = None,
    others: Choices = None,
    algorithms: str = "one",
    repeats: bool = False,
    check: str | None = "quick",
    seed: int = 0,
    engine: str = "serial",
    workers: int = 2,
    env_kwargs: Mapping[str, Any] | None = None,
) -> AgentsVectorEnv:
    """Copies of a multi-agent environment for Tianshou, Parallel or AEC; see `Collector`.

    With `algorithms="one"` all learning agents share any algorithm of Tianshou's; with "role" or
    "agent" each of `env.agents` has its own, for `MultiAgentOnPolicyAlgorithm(algorithms=[...],
    env=env)` and its off-policy sister.

    | | |
    |---|---|
    | kept | every agent's own decisions: what it saw, did, was paid until it acted again, and saw then, its end, truncated apart from terminated (Tianshou bootstraps from `obs_next`); masks in `obs.mask`, whose decision it is in `obs.agent_id` (the name in `env.agents`); an agent that comes late or ends early has a row for each decision and no other; seeds: copy e plays the episodes e, e + num_envs, ... of run `seed`, the same as `gk.rollout` |
    | changed | a sub-buffer holds one agent of one copy, not a copy; steps are decisions, episodes those of copies, their `lens` the steps of the copy (ticks, or everybody's turns), returns are [episode, agent]; collecting n episodes takes the first n of the run, however long each is. Roles with different spaces are padded: flat observations with zeros, Discrete actions with masked ones. Actions count from 0. A Dict observation loses its `action_mask`; of one other part only that part is left. A reset without a seed begins the next run, `seed` + 1, + 2, ...; with `repeats=True` the same one |
    | lost | infos but for the mask; `state()`; what was paid before an agent's first decision; in an AEC environment, what an agent saw as it ended before its copy was over (what it saw last stands there); Tianshou's hooks |
    | refused | Tianshou's own Collector (it credits a reward to who acted last, whoever earned it: take ours), policies with a hidden state, Tuple observations, roles with spaces that can't be padded (`role=`), others without a policy (`others=`), an environment that breaks the contract (`check=None` lets it pass) |

    Args:
        spec: where the environment comes from, as `gk.make` takes it.
        num_envs: how many copies.
        role: the role, or the one agent, that learns; None: everybody.
        others: policies of who doesn't learn, one for all or by agent or role.
        algorithms: how many there are: `one`, one for each `role`, one for each `agent`.
        repeats: each reset begins the same run, for tests that play the same episodes.
        check: "quick": the quick audit, once for each source digest, before the first step.
        seed: of the first run.
        engine: `serial`, `process` or `kernel`, as in `gk.vector.make`.
        workers: processes of the `process` engine.
        env_kwargs: handed to the environment.
    Raises:
        SpecError: see *refused*.
        ContractError: the audit found that the environment breaks its contract.
    """  # noqa: E501  # a row of a table is one line
    if algorithms not in SHARES:
        raise SpecError(
            "there is no such share", where="algorithms", expected=" or ".join(SHARES),
            seen=repr(algorithms),
        )  # fmt: skip
    checked(spec, check, env_kwargs=env_kwargs)
    seats = Seats(
        spec, num_envs, role=role, others=others, seed=seed, engine=engine, env_kwargs=env_kwargs,
        **({"workers": workers} if engine == "process" else {}),
    )  # fmt: skip
    return AgentsVectorEnv(seats, algorithms, repeats=repeats)


class AgentsVectorEnv:
    """Use `vector_env`.

    Attributes:
        seats: the learning agents of all copies.
        agents: names of the algorithms' agents: all of them, roles, or agents.
        agent_idx: their numbers.
        observation_space, action_space: of every learner.
        is_multi: whether there is an algorithm for each of `agents`.
    """

    is_async = False

    def __init__(self, seats: Seats, algorithms: str, *, repeats: bool) -> None:
        """Takes over the seats."""
        self.seats, self.is_multi, self._repeats = seats, algorithms != "one", repeats
        named = {
            "one": ["all"] * len(seats.learners),
            "role": [seats.role_of(agent) for agent in seats.learners],
            "agent": [str(agent) for agent in seats.learners],
        }[algorithms]
        self.agents = list(dict.fromkeys(named))
        self.agent_idx = {name: i for i, name in enumerate(self.agents)}
        self.named = np.array(named)
        self.observation_space = seats.forms.observation_space
        self.action_space = seats.forms.action_space
        self.env_num = seats.acting.size
        self._next = seats.seed

    def __len__(self) -> int:
        """How many seats: learners of all copies."""
        return self.env_num

    def reset(self, *, seed: int | None = None) -> tuple[Any, Any]:
        """Begins a run: what each seat is given, and nothing else."""
        if seed is None:
            seed, self._next = self._next, self._next + (not self._repeats)
        self.seats.reset(seed)
        return self.rows(self.seats.obs, np.ones(self.env_num, bool)), np.array([{}] * self.env_num)

    def rows(self, obs: Any, which: Any, *, ended: Any = False) -> Any:
        """What some seats are given, as Tianshou's policies take it.

        Args:
            obs: [copy, agent, ...].
            which: [seat] bool.
            ended: [seat] bool; the masks that stand there are those of their next episodes.
        """
        seen = _flat(obs, self.env_num, which)
        masks = self.seats.masks
        if masks is None and not self.is_multi:
            return seen
        found = {"obs": seen, "agent_id": np.tile(self.named, self.seats.num_envs)[which]}
        if masks is not None:
            found["mask"] = (masks.reshape(self.env_num, -1) | np.atleast_1d(ended)[:, None])[which]
        return Batch(found)

    def step(self, action: Any, id: Any = None) -> Any:  # Tianshou's names
        """Refused: only some seats decide in a step, which Tianshou's own Collector can't know.

        Raises:
            SpecError: always.
        """
        raise SpecError(
            "Tianshou's Collector takes every seat for an environment of its own",
            where="step", mend="gamekeeper.adapters.tianshou.Collector(algorithm, env, buffer)",
        )  # fmt: skip

    def seed(self, seed: int | None = None) -> list[int | None]:
        """The seed of the run that the next reset begins."""
        if seed is not None:
            self._next = seed
        return [seed] * self.env_num

    def render(self, **kwargs: Any) -> list[Any]:
        """No pictures: `gk.record(..., frames=True)` takes them."""
        return []

    def close(self) -> None:
        """Closes every copy."""
        self.seats.close()


def _flat(obs: Any, count: int, which: Any) -> Any:
    if isinstance(obs, Mapping):
        return Batch({key: _flat(part, count, which) for key, part in obs.items()})
    return obs.reshape(count, *obs.shape[2:])[which]
