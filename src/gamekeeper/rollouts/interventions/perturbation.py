"""Perturbation: an intervention that makes one thing worse, for named agents, by a strength."""

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final, Literal, Self

from gymnasium.spaces import Space
from numpy.random import Generator

from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import SpecError
from gamekeeper.interface.capture import AgentId
from gamekeeper.randomness.seeds import policy_rng
from gamekeeper.rollouts.intervention import Intervention, PlacedHooks

Unit = Literal["probability", "part", "deviation", "turns"]

UNITS: Final[dict[Unit, str]] = {
    "probability": "a probability, from 0 to 1",
    "part": "a part of the whole, from 0 to 1",
    "deviation": "a standard deviation as a part of the range, from 0 up",
    "turns": "a whole number of the agent's own turns, from 0 up",
}


@dataclass(frozen=True, slots=True)
class Perturbation(Intervention):
    """Makes one thing worse, for some agents; what depends on that thing suffers.

    What it draws comes from a stream for each agent, as many numbers at every turn whatever the
    strength: another strength is the same episode with more of the same, and agents don't depend on
    one another. With strength 0 nothing is done at all.

    Attributes:
        USUAL: a strength that an agent which needs the thing can be expected to feel.
        MOST: the strength beyond which a search needn't look.
        UNIT: what the strength is.
        ON: whether it changes what agents have `seen` (so only policies feel it) or have `done`.
        agents: names of those whom it befalls; None: everybody.
        strength: how much; 0 is nothing.
    """

    kind: ClassVar[Literal["perturbation"]] = "perturbation"
    USUAL: ClassVar[float]
    MOST: ClassVar[float] = 1.0
    UNIT: ClassVar[Unit] = "probability"
    ON: ClassVar[Literal["seen", "done"]]

    agents: tuple[str, ...] | None = None
    strength: float = 0.0

    def __post_init__(self) -> None:
        is_number = isinstance(self.strength, int | float) and math.isfinite(self.strength)
        is_fit = is_number and self.strength >= 0
        if is_fit and self.UNIT in ("probability", "part"):
            is_fit = self.strength <= 1
        elif is_fit and self.UNIT == "turns":
            is_fit = self.strength == int(self.strength)
        if not is_fit:
            raise SpecError(
                f"{type(self).__name__} can't be of that strength",
                where="strength",
                expected=UNITS[self.UNIT],
                actual=repr(self.strength)[:200],
                fix="give a strength in this unit and range",
            )
        if self.agents is not None:
            object.__setattr__(self, "agents", tuple(self.agents))

    def at(self, strength: float, agents: tuple[str, ...] | None) -> Self:
        """The same for other agents with another strength, rounded where it is in whole turns."""
        kept = float(round(strength)) if self.UNIT == "turns" else float(strength)
        return replace(self, strength=kept, agents=agents)


class PerturbationHooks(PlacedHooks):
    """The hooks of a perturbation: the agents that it is meant for, and each one's stream."""

    def __init__(self, perturbation: Perturbation, rng: Generator) -> None:
        super().__init__()
        self.strength = float(perturbation.strength)
        self._agents = None if perturbation.agents is None else frozenset(perturbation.agents)
        self._key = int(rng.integers(1 << 62))

    def is_meant(self, agent: AgentId) -> bool:
        """Tells whether it applies to an agent."""
        return self._agents is None or agent_name(agent) in self._agents

    def stream(self, agent: AgentId) -> Generator:
        """A stream of the agent's own, at its beginning."""
        return policy_rng(self._key, 0, agent)


def observation_space(env: Any, agent: AgentId) -> Space[Any] | None:
    """Observation space of an agent; None where the environment can't say."""
    return _space(getattr(env, "observation_space", None), agent)


def action_space(env: Any, agent: AgentId) -> Space[Any] | None:
    """Action space of an agent; None where the environment can't say."""
    return _space(getattr(env, "action_space", None), agent)


def _space(ask: Any, agent: AgentId) -> Space[Any] | None:
    try:
        space = ask(agent)
    except Exception:  # foreign code; what it raises here it raises where it is used, too
        return None
    return space if isinstance(space, Space) else None
