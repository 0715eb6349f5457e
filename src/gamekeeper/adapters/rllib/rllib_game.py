"""An open environment as RLlib plays it: names, roles, agents that learn, a view of each.

A view is one agent's observation in the form that a network reads, with its mask, and its actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, TypedDict

import numpy as np
from gymnasium import spaces

from gamekeeper.adapters.requirements import closed_on_error, learners_of, require_policies, role_of
from gamekeeper.adapters.slot_views import bare_space
from gamekeeper.contract import Contract
from gamekeeper.errors import SpecError
from gamekeeper.interface.action_mask import Reader, reader
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.joint_policy import Choices, JointPolicy
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.slim import slim
from gamekeeper.randomness.seeds import EpisodeSeeds
from gamekeeper.runs.recording import joint_policy_of
from gamekeeper.vector.sub_env_block import put_mask
from gamekeeper.vector.vector_form import MASK, VectorGroup, form_of

OBSERVATIONS: Final = "observations"
"""The name of the bare observation beside its mask, as RLlib's ActionMaskingRLModule reads it."""


@dataclass(frozen=True, slots=True)
class AgentView:
    """One agent as RLlib sees it.

    Attributes:
        observation_space: of what `shown` gives.
        action_space: of what `meant` takes; a Discrete counts from 0.
        bare: the observation's own space, without the mask.
        key: of the observation in a Dict that holds nothing else but the mask.
        flags: length of the mask; 0: no mask is shown.
        place: of the mask, by the contract; None: the contract doesn't say.
        flat: the observation is one row of numbers.
        start: number that is added to an action.
    """

    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]
    bare: spaces.Space[Any]
    key: str | None
    flags: int
    place: str | None
    flat: bool
    start: Any

    def shown(self, observation: Any, info: Any) -> Any:
        """An observation of the environment as RLlib gets it."""
        seen = observation
        if isinstance(seen, dict) and MASK in seen:
            rest = {key: part for key, part in seen.items() if key != MASK}
            seen = rest if self.key is None else rest[self.key]
        if self.flat:
            seen = np.asarray(spaces.flatten(self.bare, seen), np.float32)
        if not self.flags:
            return seen
        mask = np.empty(self.flags, np.float32)
        put_mask(mask, _reader(self.place)(observation, info))
        return {MASK: mask, OBSERVATIONS: seen}

    def meant(self, action: Any) -> Any:
        """An action of RLlib as the environment takes it."""
        return action if self.start is None else action + self.start


def view_of(group: VectorGroup, place: str | None, *, masks: bool, flatten: bool) -> AgentView:
    """View of a group's agents, as RLlib sees them.

    Args:
        group: their spaces, and how long their masks are.
        place: of a mask, by the contract.
        masks: masks stand in observations.
        flatten: makes one row of numbers of an observation.
    Raises:
        SpecError: RLlib has no distribution for the actions.
    """
    _check_actions(group)
    bare, key = bare_space(group.observation_space)
    shown: spaces.Space[Any] = bare
    if flatten:
        shown = _row(bare, group)
    flags = group.flags if masks else 0
    if flags:
        legal = spaces.Box(0.0, 1.0, (flags,), np.float32)
        shown = spaces.Dict({MASK: legal, OBSERVATIONS: shown})
    action, start = _from_zero(group.action_space)
    return AgentView(shown, action, bare, key, flags, place, flatten, start)


@cache
def _reader(place: str | None) -> Reader:
    return reader(place)


def _row(space: spaces.Space[Any], group: VectorGroup) -> spaces.Box:
    row = spaces.flatten_space(space)
    if not isinstance(row, spaces.Box):
        raise SpecError(
            "an observation can't be made one row of numbers",
            where=f"agents {group.agents}",
            expected="Box, Discrete, MultiDiscrete, MultiBinary, and Dict or Tuple of them",
            actual=str(space)[:200],
            fix="flatten=False, and a module that reads such observations",
        )
    return spaces.Box(row.low.astype(np.float32), row.high.astype(np.float32), dtype=np.float32)


def _check_actions(group: VectorGroup) -> None:
    """Refuses actions that RLlib's distributions don't draw as the environment takes them."""
    space = group.action_space
    waiting: list[Any] = [space]
    while waiting:
        part = waiting.pop()
        if isinstance(part, spaces.Dict | spaces.Tuple):
            waiting += part.spaces.values() if isinstance(part, spaces.Dict) else part.spaces
        elif isinstance(part, spaces.MultiBinary) or (
            part is not space and _from_zero(part)[1] is not None
        ):
            raise SpecError(
                "RLlib has no distribution for such actions",
                where=f"agents {group.agents}",
                expected="Discrete, MultiDiscrete, Box; Dict or Tuple of them, counting from 0",
                actual=str(space)[:200],
                fix="MultiDiscrete in place of MultiBinary, or count from 0, in the environment",
            )


def _from_zero(space: spaces.Space[Any]) -> tuple[spaces.Space[Any], Any]:
    """An action space that counts from 0, as RLlib's distributions draw, and what is added."""
    if isinstance(space, spaces.Discrete) and space.start:
        return spaces.Discrete(int(space.n), dtype=space.dtype), space.start
    if isinstance(space, spaces.MultiDiscrete) and np.any(space.start):
        return spaces.MultiDiscrete(space.nvec, dtype=space.dtype), space.start
    return space, None


@dataclass(frozen=True, slots=True)
class RLlibMultiAgentEnv:
    """An open environment, and the part of it that RLlib plays.

    Attributes:
        env, api: the environment; `aec` or `parallel`.
        views: by the name of each learner, in the order of `possible_agents`.
        role_of: by the name of each agent, learner or not, its role.
        agent_of, name_of: names are texts, which an environment's own agents needn't be.
        policies: of the other agents; None where all agents learn.
    """

    env: Any
    api: str
    views: Mapping[str, AgentView]
    role_of: Mapping[str, str]
    agent_of: Mapping[str, Any]
    name_of: Mapping[Any, str]
    policies: JointPolicy | None


class Options(TypedDict, total=False):
    """Options of an environment that RLlib plays; `multi_agent_env` explains each of them."""

    role: str | None
    others: Choices
    masks: bool
    flatten: bool
    env_kwargs: Mapping[str, Any] | None


def opened_game(
    spec: object,
    *,
    role: str | None = None,
    others: Choices = None,
    masks: bool = True,
    flatten: bool = False,
    env_kwargs: Mapping[str, Any] | None = None,
) -> RLlibMultiAgentEnv:
    """Opens an environment, finds the agents that learn and makes the policies of the others.

    Raises:
        SpecError: no agent has the role, another agent has no policy, or agents have no names yet.
    """
    opened = open_env(spec, **dict(env_kwargs or {}))
    with closed_on_error(opened.env):
        contract = declared_contract(None, opened) or Contract()
        env = slim(opened.env)
        views = _views(env, opened.api, contract, masks=masks, flatten=flatten)
        learners = learners_of(views, role, contract)
        rest = [agent for agent in views if agent not in learners]
        require_policies(rest, others, contract)
        policies = joint_policy_of(others, opened.env, contract) if rest else None
    return RLlibMultiAgentEnv(
        env,
        opened.api,
        {str(agent): views[agent] for agent in learners},
        {str(agent): role_of(contract, agent) for agent in views},
        {str(agent): agent for agent in views},
        {agent: str(agent) for agent in views},
        policies,
    )


def _views(
    env: Any, api: str, contract: Contract, *, masks: bool, flatten: bool
) -> dict[Any, AgentView]:
    """View of each agent, in the order of `possible_agents`."""
    given = env.reset(seed=EpisodeSeeds(0)[0])  # the place of masks is known after a reset
    form = form_of(env, api, contract, env.infos if api == "aec" else given[1])
    found = {
        agent: view_of(group, contract.mask_of(agent), masks=masks, flatten=flatten)
        for group in form.groups
        for agent in group.agents
    }
    return {agent: found[agent] for agent in env.possible_agents}
