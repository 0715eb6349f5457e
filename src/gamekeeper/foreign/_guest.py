"""`ForeignEnv`: what every environment of another shape has in common behind the Parallel API."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import ParallelEnv

from gamekeeper.contract import Contract
from gamekeeper.contract.sections import RewardTerm, Schedule
from gamekeeper.errors import EnvError, OrderError, SpecError
from gamekeeper.interface.contract_draft import draft_contract
from gamekeeper.interface.legality import mismatch

Given = dict[str, Any]

TEAM: Final = "team"
"""The term under which a reward stands that the environment pays to all of its agents at once."""
TIME_LIMIT: Final = "time limit"
"""Reason given for an agent truncated by the limit that its own environment reported."""
LIMITS: Final = (
    "max_steps",
    "_max_steps",
    "max_episode_steps",
    "_max_episode_steps",
    "episode_limit",
    "time_limit",
    "horizon",
)
"""Attributes in which environments keep the number of ticks after which they end."""


@dataclass(frozen=True, slots=True)
class ForeignStep:
    """One tick of the other shape, by agent."""

    observations: Given
    rewards: dict[str, Any]
    terminated: dict[str, bool]
    truncated: dict[str, bool]
    infos: dict[str, dict[str, Any]]


class ForeignEnv(ParallelEnv[Any, Any, Any]):
    """An environment of another shape whose agents all act at once, as a ParallelEnv.

    A subclass settles agents and spaces with `_settle`, and writes `_begin` and `_play`. The books
    are kept here: who ended leaves `agents` and is asked for nothing more. A reward for one who
    ended earlier stays in `rewards`, where an audit sees it.

    Attributes:
        unknown: what that shape can't say, a sentence each; nothing is guessed for it.
        contract: what is known before the first step; all else is left open in it.
        optionless: whose shape has a reset that takes no options; empty: the guest gets them.
        endings: why agents ended, where that is known.
        terms: what the last tick paid by term, where the shape tells.
    """

    unknown: tuple[str, ...] = ()
    optionless: ClassVar[str] = ""
    why: ClassVar[str] = "its step takes an action of every agent and answers once"
    terms: dict[str, dict[str, float]]

    def __init__(self, guest: Any, *, name: str) -> None:
        self.guest = guest
        found = getattr(guest, "metadata", None)
        kept = dict(found) if isinstance(found, Mapping) else {}
        self.metadata = {"render_modes": [], **kept, "name": name}
        self.render_mode: str | None = getattr(guest, "render_mode", None)
        self.possible_agents: list[str] = []
        self.agents: list[str] = []
        self.endings: dict[str, str] = {}
        self.turns = 0
        self._limit: int | None = None
        self._is_reset = False

    def _settle(
        self,
        agents: Sequence[str],
        observation_spaces: Sequence[Space[Any]],
        action_spaces: Sequence[Space[Any]],
        *,
        limit: int | None = None,
        is_team_paid: bool = False,
    ) -> None:
        """Notes roster and spaces, and drafts the contract.

        Args:
            agents: in the order of the other shape's lists.
            limit: after how many ticks the environment ends by itself, without saying that it was
                its limit; such an end is a truncation.
            is_team_paid: it pays one reward to all.
        """
        self.possible_agents = list(agents)
        self.observation_spaces = dict(zip(agents, observation_spaces, strict=True))
        self.action_spaces = dict(zip(agents, action_spaces, strict=True))
        self._limit = limit
        if is_team_paid:
            self.terms = {}
        self.contract: Contract = replace(
            draft_contract(self),
            why=self.why,
            schedule=Schedule(horizon=limit),
            rewards={TEAM: RewardTerm(kind="shared")} if is_team_paid else {},
        )

    # -- what a shape writes

    def _begin(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Given, Given]:
        """Resets the guest: observations and infos by agent."""
        raise NotImplementedError

    def _play(self, actions: Given) -> ForeignStep:
        """One tick, with an action of every live agent."""
        raise NotImplementedError

    # -- PettingZoo's side

    def observation_space(self, agent: str) -> Space[Any]:
        """The space of an agent's observations, the same object every time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """The space of an agent's actions, the same object every time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Given, Given]:
        """Begins an episode: observations, infos.

        Raises:
            SpecError: there are options, and the reset of that shape takes none.
        """
        if options and self.optionless:
            raise SpecError(
                f"{self.optionless}'s reset takes no options",
                where="options",
                actual=f"{options!r}"[:100],
                fix="leave options out",
            )
        observations, infos = self._begin(seed, options)
        self.agents, self.turns, self.endings, self._is_reset = [*self.possible_agents], 0, {}, True
        if hasattr(self, "terms"):
            self.terms = {}
        return observations, infos

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[Given, dict[str, Any], dict[str, bool], dict[str, bool], Given]:
        """Plays one tick: observations, rewards, terminations, truncations, infos.

        Raises:
            OrderError: there was no reset, or everybody has ended.
            ActionError: an agent has no action, or one that isn't live has one.
        """
        self._check(actions)
        out = self._play({agent: actions[agent] for agent in self.agents})
        self.turns += 1
        live, (terminated, truncated) = self.agents, self._told_apart(out)
        self.agents = [agent for agent in live if not (terminated[agent] or truncated[agent])]
        rewards = {agent: out.rewards[agent] for agent in live}
        for agent, reward in out.rewards.items():
            if agent not in rewards and reward != 0:  # paid after its end: told, not swallowed
                rewards[agent] = reward
        if hasattr(self, "terms"):
            self.terms = self._terms(rewards)
        shown = ({agent: part[agent] for agent in live} for part in (out.observations, out.infos))
        observations, infos = shown
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Any:
        """Renders the guest, in the mode that it was built with; many open a window without."""
        return None if self.render_mode is None else self.guest.render()

    def close(self) -> None:
        """Closes the guest."""
        close = getattr(self.guest, "close", None)
        if callable(close):
            close()

    # -- the books

    def _terms(self, rewards: Mapping[str, Any]) -> dict[str, dict[str, float]]:
        return {agent: {TEAM: float(reward)} for agent, reward in rewards.items()}

    def _told_apart(self, out: ForeignStep) -> tuple[dict[str, bool], dict[str, bool]]:
        """Flags of the live; an end of all in the tick of the limit is the limit's."""
        terminated = {agent: out.terminated[agent] for agent in self.agents}
        truncated = {agent: out.truncated[agent] for agent in self.agents}
        is_at_limit = self._limit is not None and self.turns >= self._limit
        if is_at_limit and all(terminated.values()) and not any(truncated.values()):
            self.endings |= dict.fromkeys(self.agents, TIME_LIMIT)
            return truncated, terminated
        return terminated, truncated

    def _check(self, actions: Mapping[str, Any]) -> None:
        if not self.agents:
            said = "everybody has ended" if self._is_reset else "there was no reset"
            raise OrderError(f"step came when {said}", where="step", fix="call reset first")
        if not isinstance(actions, Mapping) or set(actions) != set(self.agents):
            raise mismatch(actions, self.agents)


def limit_of(env: Any) -> int | None:
    """After how many ticks an environment says that it ends by itself; None: it doesn't say."""
    for name in LIMITS:
        limit = getattr(env, name, None)
        if type(limit) is int and limit > 0:
            return limit
    return None


def numbered(count: int) -> list[str]:
    """Names for agents that have only numbers: `agent_0`, `agent_1`."""
    return [f"agent_{number}" for number in range(count)]


def wrong_shape(what: str, *, expected: str, actual: object) -> EnvError:
    """The error for an environment that isn't of the shape it was opened as."""
    return EnvError(
        f"{what} isn't of the shape that the environment was opened as",
        where=what,
        expected=expected,
        actual=f"{type(actual).__name__} {actual!r}"[:200],
        fix="open it in the shape that it has; docs/shapes.md lists them",
    )


MASK: Final = "action_mask"
MASKS: Final = (MASK, "avail_actions", "available_actions", "legal_actions")
"""Keys under which environments put their masks into an info, a row for each agent."""
ALL: Final = "__all__"
"""The key under which dictionaries of flags tell that the episode is over."""


def dealt(values: Any, agents: Sequence[str], what: str) -> Given:
    """One value for each agent: of a dictionary by name, of a list, tuple or array by place.

    Raises:
        EnvError: it is nothing of these, or of another length.
    """
    if isinstance(values, Mapping):
        if all(agent in values for agent in agents):
            return {agent: values[agent] for agent in agents}
    elif _is_row(values) and len(values) == len(agents):
        return dict(zip(agents, values, strict=True))
    raise wrong_shape(what, expected=f"one of each of {len(agents)} agents", actual=values)


def flags(values: Any, agents: Sequence[str], what: str) -> dict[str, bool]:
    """One flag for each agent; one alone is everybody's.

    Raises:
        EnvError: it is neither a flag nor one of each agent.
    """
    if isinstance(values, bool | np.bool_ | int | np.integer) or (
        isinstance(values, np.ndarray) and not values.ndim
    ):
        return dict.fromkeys(agents, bool(values))
    if isinstance(values, Mapping) and values.get(ALL):
        values = {**dict.fromkeys(agents, True), **values}
    return {agent: bool(flag) for agent, flag in dealt(values, agents, what).items()}


def rewards(values: Any, agents: Sequence[str]) -> dict[str, Any]:
    """One reward for each agent; one alone is paid to everybody in full.

    Raises:
        EnvError: it is neither a number nor one of each agent.
    """
    if isinstance(values, int | float | np.number | np.bool_) or (
        isinstance(values, np.ndarray) and not values.ndim
    ):
        return dict.fromkeys(agents, float(values))
    return {agent: _plain(paid) for agent, paid in dealt(values, agents, "rewards").items()}


def infos(info: Any, agents: Sequence[str]) -> dict[str, dict[str, Any]]:
    """One info for each agent: its own where they come so, else a copy of everybody's.

    A mask with a row for each agent comes apart, and stands under `action_mask`.
    """
    if isinstance(info, list | tuple) and len(info) == len(agents):
        return {
            agent: dict(one) if isinstance(one, Mapping) else {"info": one}
            for agent, one in zip(agents, info, strict=True)
        }
    if not isinstance(info, Mapping):
        raise wrong_shape("infos", expected="a dictionary, or one of each agent", actual=info)
    if info and all(isinstance(info.get(agent), Mapping) for agent in agents):
        common = {key: value for key, value in info.items() if key not in agents}
        return {agent: {**common, **info[agent]} for agent in agents}
    rows = next((name for name in MASKS if _is_rows(info.get(name), len(agents))), None)
    common = {key: value for key, value in info.items() if key != rows}
    if rows is None:
        return {agent: dict(common) for agent in agents}
    return {
        agent: {**common, MASK: np.asarray(row, dtype=np.int8)}
        for agent, row in zip(agents, info[rows], strict=True)
    }


def _is_rows(value: Any, count: int) -> bool:
    return _is_row(value) and len(value) == count and all(map(_is_row, value))


def _is_row(value: Any) -> bool:
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def _plain(paid: Any) -> Any:
    """A reward out of an array without axes; anything else as it is, also what is no number."""
    return paid.item() if isinstance(paid, np.ndarray) and paid.size == 1 else paid
