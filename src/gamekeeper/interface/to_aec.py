"""From all agents at once to one after the other: Parallel environments behind AEC."""

import copy
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
from pettingzoo import ParallelEnv

from gamekeeper.errors import ContractError
from gamekeeper.interface.author_calls import (
    TERMINATED,
    TRUNCATED,
    AgentId,
    before_reset,
    reset_arguments,
)
from gamekeeper.interface.bookkeeping import Books
from gamekeeper.interface.env_inside import EnvInside

REWARDS: Final = (float, int, np.generic, np.ndarray)  # an array: a reward of several objectives
PARTS: Final = ("observations", "rewards", "terminations", "truncations")


class ToAEC(EnvInside, Books):
    """A Parallel environment as an AEC environment: a tick is one round of turns.

    The law. Let a tick begin with the agents a1 ... an, in the order of the environment's own
    roster. Then there are n turns, of a1 ... an in this order; the environment steps within the
    last of them, with the n actions in this order. At its turn `last()` gives each agent what the
    tick before gave it: observation, reward, both flags, info. A tick is paid at its last turn,
    the other turns pay nothing. Who ended gets its last observation, reward, flags and info at a
    turn of its own, in which it can only do None, before the next tick begins.

    | | |
    |---|---|
    | kept | agents and their order, also where it changes from tick to tick; late joiners; spaces; seeds and options; every observation, reward, flag and info, the last ones of the dying too; masks; `state()`, `state_space`, rendering, render mode; reasons of endings and reward terms where the environment tells them |
    | changed | `metadata["is_parallelizable"]` is True; who has ended stands behind the living until its last turn; infos that aren't by agent are given to everybody |
    | checked | the order of calls, and every action against its space (masks are left to the environment's rules): what is refused changes nothing |
    | lost | the last observation of who leaves the roster without an ending. What else the AEC interface can't hold is refused: an agent that comes back after its end, or is paid as it leaves without one, and dictionaries without an agent that acted or is in the roster |

    `state()` and `render()` show the environment as it is: between the turns of a tick nothing in
    it has changed yet.
    """  # noqa: E501  # rows of a table

    __slots__ = (
        "__acts",
        "__lingering",
        "__observations",
        "__order",
        "env",
        "metadata",
        "possible_agents",
        "render_mode",
        "state_space",
    )

    metadata: dict[str, Any]
    render_mode: str | None
    __acts: dict[Any, Any]  # of those who had their turn in this tick
    __order: list[Any]  # whose turns make this tick
    __observations: Mapping[Any, Any]
    __lingering: set[Any]  # who ended and is in the environment's roster all the same

    def __init__(self, env: ParallelEnv[Any, Any, Any]) -> None:
        """Takes hold of an environment; nothing is called on it yet."""
        super().__init__()
        self.env = env
        self.metadata = {**(getattr(env, "metadata", None) or {}), "is_parallelizable": True}
        self.render_mode = getattr(env, "render_mode", None)
        self.possible_agents = getattr(env, "possible_agents", [])
        if hasattr(env, "state_space"):
            self.state_space = env.state_space
        if isinstance(getattr(env, "terms", None), dict):
            self.terms = {}

    def state(self) -> Any:
        """The environment's own state.

        Raises:
            OrderError: there was no reset.
        """
        self.__after_reset("state")
        return super().state()

    def render(self) -> Any:
        """The environment's own picture.

        Raises:
            OrderError: there was no reset.
        """
        self.__after_reset("render")
        return super().render()

    # -- PettingZoo's side

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begins an episode: the environment's own `reset` with the same seed and options.

        Raises:
            ContractError: the environment begins without agents, or without an observation of one.
        """
        observations, infos = self.env.reset(**reset_arguments(seed, options))
        live = list(self.env.agents)
        self.possible_agents = getattr(self.env, "possible_agents", [*live])
        self._open(live)
        for agent in live:
            if agent not in observations:
                raise _lacks("reset", "observations", agent)
        self.infos.update(_infos_of(infos, live))
        self.__observations, self.__lingering = observations, set()
        self.__acts, self.__order = {}, live[:]
        self._begin(live[0])

    def observe(self, agent: AgentId) -> Any:
        """Observation of an agent from the last tick, or the reset.

        Raises:
            OrderError: there was no reset.
        """
        self.__after_reset("observe")
        return self.__observations[agent]

    def _view(self, agent: AgentId) -> Any:
        """The same, for `last`."""
        return self.__observations[agent]

    def _judge(self, agent: AgentId, action: Any) -> tuple[bool, Any]:
        """Lets NumPy's whole numbers through at the price of Python's; else asks the space."""
        if isinstance(action, np.integer) and int(action) in self._range_of(agent):
            return True, action
        return super()._judge(agent, action)

    def __after_reset(self, call: str) -> None:
        if not hasattr(self, "agents"):
            raise before_reset(call)

    # -- turns and ticks

    def act(self, agent: AgentId, action: Any) -> None:
        """Keeps a copy of the action; the last one of a tick lets the environment step."""
        acts = self.__acts
        if isinstance(action, np.ndarray):  # a reader may use one array for the actions of all
            action = action.copy()
        elif not isinstance(action, int | np.generic):
            action = copy.deepcopy(action)
        acts[agent] = action
        if len(acts) == len(self.__order):
            self.__step(acts)

    def next_agent(self, agent: AgentId) -> Any:
        """The next of this tick, or the first of the next."""
        return self.__order[len(self.__acts)]

    def __step(self, acts: dict[Any, Any]) -> None:
        """The environment's step, written into the books."""
        out = self.env.step(self._handed(acts))
        observations, rewards, terminations, truncations, infos = out
        roster = self.env.agents
        if self.agents != roster or len(terminations) != len(roster):
            self.__admit(roster, terminations, truncations)
        paid, owed, cumulative = self.touched.paid, self.rewards, self._cumulative_rewards
        terms, truncs, ended = self.terminations, self.truncations, False
        try:
            for agent in self.agents:
                if agent not in observations:
                    raise _lacks("step", "observations", agent)
                owed[agent] = reward = rewards[agent]
                if reward.__class__ is not float and not isinstance(reward, REWARDS):
                    raise _unpayable(agent, reward)
                paid[agent] = None
                # what the books add the reward to, so that the sum is the reward to the last bit
                cumulative[agent] = -0.0 if reward.__class__ is float else 0
                terms[agent] = terminated = terminations[agent]
                truncs[agent] = truncated = truncations[agent]
                if terminated or truncated:
                    ended = True
        except KeyError:
            raise self.__gap(out) from None
        self.infos.update(_infos_of(infos, self.agents))
        self.__observations = observations
        if ended:
            self.__note_ends()
        if isinstance(getattr(self.env, "terms", None), dict):
            self.terms.update(self.env.terms)
        self.__turn_over(roster)

    def _handed(self, acts: dict[Any, Any]) -> dict[Any, Any]:
        """The actions as the environment gets them: in the order of its roster."""
        return acts

    def __admit(
        self, roster: Iterable[Any], terminations: Mapping[Any, Any], truncations: Mapping[Any, Any]
    ) -> None:
        """Brings those into the books who weren't there, also where they end at once."""
        known, endings = self.rewards, self.endings
        for agent in roster:
            if agent in endings and agent not in known and agent not in self.__lingering:
                raise ContractError(
                    f"agent {agent!r} came back after it had ended",
                    where="agents",
                    expected="an agent that hasn't ended in this episode",
                    actual=f"one that ended: {endings[agent]}",
                    fix="let it come back under another name",
                )
        stillborn = [
            agent for agent in terminations if terminations[agent] or truncations.get(agent)
        ]
        for agent in (*roster, *stillborn):
            if agent in known or agent in endings:
                continue
            self._enter(agent)
            self.touched.joined.append(agent)
            if not hasattr(self.env, "possible_agents"):
                self.possible_agents.append(agent)
        live = set(roster)
        stays = [agent for agent in self.agents if agent in live or agent in terminations]
        if len(stays) < len(self.agents):  # one left without an ending, as a contract may allow
            self._arrange(stays)

    def __note_ends(self) -> None:
        """Notes who has ended in this tick, and why, where the environment's rules say so."""
        reasons = getattr(self.env.unwrapped, "endings", None)
        named = reasons if isinstance(reasons, Mapping) else {}
        for agent in self.agents:
            if self.terminations[agent] or self.truncations[agent]:
                usual = TERMINATED if self.terminations[agent] else TRUNCATED
                self.endings[agent] = named.get(agent, usual)
                self.touched.ended.append(agent)

    def __turn_over(self, roster: Iterable[Any]) -> None:
        """The next tick is the turns of those who live, in the environment's order."""
        endings = self.endings
        live = list(roster)
        if endings:
            self.__lingering = {agent for agent in live if agent in endings}
            live = [agent for agent in live if agent not in endings]
        ended = self.touched.ended
        dying = self._leaving(ended) if ended else []
        if self.agents != [*live, *dying]:
            staying = {*live, *dying}
            for agent in self.agents:
                if agent not in staying and np.any(self.rewards[agent]):
                    raise _unkept(agent, self.rewards[agent])
            self._arrange([*live, *dying])
        self.__acts, self.__order = {}, live

    def _leaving(self, ended: list[Any]) -> list[Any]:
        """In which order those who ended have their last turns: that of the roster."""
        leaving = set(ended)
        return [agent for agent in self.agents if agent in leaving]

    def __gap(self, out: tuple[Any, ...]) -> ContractError:
        """Error that names the dictionary of a step that lacks an agent."""
        for name, part in zip(PARTS, out, strict=False):
            for agent in self.agents:
                if agent not in part:
                    return _lacks("step", name, agent)
        raise AssertionError("unreachable: a KeyError without a gap")


def _infos_of(infos: Any, agents: Iterable[Any]) -> dict[Any, Any]:
    """Each agent's own info; what is by no agent is of all who have none of their own."""
    try:
        return {agent: infos[agent] for agent in agents}
    except KeyError:
        agents = list(agents)
        common = {key: value for key, value in infos.items() if key not in agents}
        return {agent: infos[agent] if agent in infos else dict(common) for agent in agents}


def _unpayable(agent: AgentId, reward: object) -> ContractError:
    return ContractError(
        f"agent {agent!r} was paid what is no number",
        where="step, rewards",
        expected="a number, or an array of them",
        actual=f"{reward!r} ({type(reward).__name__})"[:300],
        fix="pay 0 where nothing is earned",
    )


def _unkept(agent: AgentId, reward: object) -> ContractError:
    return ContractError(
        f"agent {agent!r} was paid as it left without an ending",
        where="step, agents",
        expected="terminated or truncated: without a last turn nobody can be told a reward",
        actual=f"both flags False, a reward of {reward!r}, and no place in env.agents",
        fix="truncate whoever leaves",
    )


def _lacks(call: str, part: str, agent: AgentId) -> ContractError:
    return ContractError(
        f"{call}() gave no {part} for agent {agent!r}",
        where=f"{call}, {part}",
        expected="every agent that acted, and every one in env.agents",
        actual=f"no key {agent!r}",
        fix="give those who end their last observation, reward and flags too",
    )
