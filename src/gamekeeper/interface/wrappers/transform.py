"""One agent's side of an environment, changed: what a wrapper does, whatever the interface.

A transform is written once; `wrapped` puts it around a ParallelEnv or an AECEnv.
"""

from collections.abc import Callable, Mapping
from typing import Any

from gymnasium.spaces import Space
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import SpecError
from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.env_source import possible_agents_of


class Transform:
    """Changes what an agent is shown, does and is paid; as it stands, nothing.

    `observation` and `info` may be asked for at any time, any number of times: they change nothing.
    Memory is written in `keep` alone, once for each action that the environment has taken, with
    what `note` copied before it: an environment may write into the arrays that it has handed out.
    """

    def bind(self, env: Any) -> None:
        """Takes the environment that is wrapped; its spaces may be read."""

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """Space of what the agent is shown, from the environment's own."""
        return space

    def action_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """Space of what the agent does, from the environment's own."""
        return space

    def begin(self, seed: int | None) -> None:
        """Begins an episode; `seed` as `reset` was given it."""

    def given(self, agent: AgentId, seen: Any, info: Mapping[str, Any]) -> None:
        """Copies what counts for the agent's next action, before anybody can write into it."""

    def observation(self, agent: AgentId, seen: Any, info: Mapping[str, Any]) -> Any:
        """Returns what the agent is shown, from what the environment gave."""
        return seen

    def info(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The agent's info, a new dictionary where it differs."""
        return info

    def action(self, agent: AgentId, action: Any) -> Any:
        """The action that the environment is given."""
        return action

    def reward(self, agent: AgentId, reward: Any) -> Any:
        """The agent's reward, from what one step of the environment paid it; 0 stays 0."""
        return reward

    def note(self, agent: AgentId, seen: Any, action: Any) -> Any:
        """Copy of what is remembered of a decision; `action` is the one that goes inside."""
        return None

    def keep(self, agent: AgentId, noted: Any) -> None:
        """Remembers a decision, once the environment has taken it."""

    # all agents of one tick of a ParallelEnv; these are the above, agent by agent

    def observations(self, seen: Mapping[Any, Any], infos: Any) -> dict[Any, Any]:
        """Returns what each agent is shown."""
        show, info = self.observation, infos_by(infos)
        return {agent: show(agent, one, info(agent, {})) for agent, one in seen.items()}

    def notes(self, seen: Mapping[Any, Any], actions: Mapping[Any, Any]) -> Any:
        """Copies of what is remembered of all decisions of a tick."""
        note, of = self.note, seen.get
        return [(agent, note(agent, of(agent), action)) for agent, action in actions.items()]

    def keep_all(self, noted: Any) -> None:
        """Remembers the decisions of a tick, once the environment has taken them."""
        keep = self.keep
        for agent, one in noted:
            keep(agent, one)

    def overrides(self, *names: str) -> bool:
        """Tells whether one of these methods does anything."""
        return any(getattr(type(self), name) is not getattr(Transform, name) for name in names)


class TransformedSpaces:
    """Spaces, name and attributes that both forms of a wrapper share."""

    env: Any
    transform: Transform
    _known: dict[tuple[str, AgentId], Space[Any]]

    def _take(self, transform: Transform) -> None:
        self.transform, self._known = transform, {}
        transform.bind(self.env)
        self._shows = transform.overrides("observation")
        self._informs = transform.overrides("info")
        self._acts = transform.overrides("action")
        self._pays = transform.overrides("reward")
        self._gives = transform.overrides("given")
        self._notes = transform.overrides("note", "keep")
        for agent in getattr(self.env, "possible_agents", ()):  # what it can't take fails at once
            self.observation_space(agent)
            self.action_space(agent)

    def observation_space(self, agent: AgentId) -> Space[Any]:
        """Space of what the agent is shown; the same object at every call."""
        return self._space("observation_space", agent)

    def action_space(self, agent: AgentId) -> Space[Any]:
        """Space of what the agent does; the same object at every call."""
        return self._space("action_space", agent)

    def _space(self, kind: str, agent: AgentId) -> Space[Any]:
        space = self._known.get((kind, agent))
        if space is None:
            inner = getattr(self.env, kind)(agent)
            space = self._known[kind, agent] = getattr(self.transform, kind)(agent, inner)
        return space

    @property
    def observation_spaces(self) -> dict[Any, Space[Any]]:
        """Observation spaces of all possible agents."""
        return {agent: self.observation_space(agent) for agent in self._roster()}

    @property
    def action_spaces(self) -> dict[Any, Space[Any]]:
        """Action spaces of all possible agents."""
        return {agent: self.action_space(agent) for agent in self._roster()}

    def _roster(self) -> Any:
        """All agents; where the environment doesn't name them beforehand, those that are there."""
        found = getattr(self.env, "possible_agents", None)
        return getattr(self.env, "agents", ()) if found is None else found

    def __str__(self) -> str:
        return f"{type(self.transform).__name__}<{self.env}>"


def possible(env: Any, wrapper: str) -> list[Any]:
    """All agents that may appear.

    Raises:
        SpecError: the environment doesn't name them before a reset.
    """
    agents = possible_agents_of(env)
    if not agents:
        raise SpecError(
            f"{wrapper} needs to know all agents beforehand",
            where=wrapper,
            expected="possible_agents, with every agent that may appear",
            actual="none",
            fix="set possible_agents in the environment's __init__",
        )
    return agents


def is_parallel(env: Any, wrapper: str) -> bool:
    """Tells which of PettingZoo's interfaces an environment has.

    Raises:
        SpecError: it has neither.
    """
    if isinstance(env, ParallelEnv | AECEnv):
        return isinstance(env, ParallelEnv)
    raise SpecError(
        "only a PettingZoo environment can be wrapped",
        where=wrapper,
        expected="an AECEnv or a ParallelEnv",
        actual=f"{type(env).__module__}.{type(env).__qualname__}",
        fix="open it first: gamekeeper.make(spec); batches have gamekeeper.vector.wrappers",
    )


def unfit(wrapper: str, agent: AgentId, *, expected: str, actual: object, fix: str) -> SpecError:
    """Error that names the agent whose space a wrapper can't take."""
    return SpecError(
        f"{wrapper} can't take the space of {agent!r}",
        where=f"{wrapper}, {agent!r}",
        expected=expected,
        actual=f"{actual}"[:300],
        fix=fix,
    )


def infos_by(infos: Any) -> Callable[[AgentId, Any], Any]:
    """Function that finds an agent's own info, or what else is given."""
    found: Callable[[AgentId, Any], Any] = infos.get if isinstance(infos, Mapping) else {}.get
    return found
