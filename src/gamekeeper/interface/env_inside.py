"""Attributes and calls that every conversion hands on to the environment inside it."""

from operator import attrgetter
from typing import Any

from gymnasium.spaces import Space
from pettingzoo.utils.conversions import aec_to_parallel

from gamekeeper.interface.author_calls import AgentId


def handed_on(path: str) -> Any:
    """A property that gives what stands at this path, as `env.agents`, whatever it is."""
    return property(attrgetter(path), doc=f"The environment's own `{path.rpartition('.')[2]}`.")


class EnvInside:
    """Spaces, state, picture and end of the environment inside, which stands in `env`."""

    __slots__ = ()

    env: Any
    possible_agents: list[Any]

    unwrapped = handed_on("env.unwrapped")

    def observation_space(self, agent: AgentId) -> Space[Any]:
        """The environment's own observation space of an agent."""
        # the environment's answer, whatever it is
        return self.env.observation_space(agent)  # type: ignore[no-any-return]

    def action_space(self, agent: AgentId) -> Space[Any]:
        """The environment's own action space of an agent."""
        # the environment's answer, whatever it is
        return self.env.action_space(agent)  # type: ignore[no-any-return]

    @property
    def observation_spaces(self) -> dict[Any, Space[Any]]:
        """The observation spaces of all possible agents."""
        return {agent: self.observation_space(agent) for agent in self.possible_agents}

    @property
    def action_spaces(self) -> dict[Any, Space[Any]]:
        """The action spaces of all possible agents."""
        return {agent: self.action_space(agent) for agent in self.possible_agents}

    def state(self) -> Any:
        """The environment's own state."""
        return self.env.state()

    def render(self) -> Any:
        """The environment's own picture."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def __str__(self) -> str:
        return str(self.env)


def pettingzoo_parallel(env: Any) -> Any:
    """The AEC environment `env` behind PettingZoo's `aec_to_parallel`, as other libraries see it.

    Raises:
        AssertionError: its metadata doesn't say that it is parallelizable.
    """
    return aec_to_parallel(env)
