"""Facts of the probes `illegal` and `ended`: actions that the rules need not take."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class TriedAction:
    """An illegal action, or a legal one that random play seldom comes to, on a fresh episode.

    Attributes:
        is_legal: whether it is a legal one.
        case: `outside`, `below`, `masked`, `none`, `nan`, `missing`, `stranger`; legal ones `low`,
            `high`, `plain`, `narrow`.
        action: actions as they were handed to step.
        raised: by the step.
        reward: paid to the agent.
        legal_reward: paid for the legal action.
        is_over: whether the agent has ended.
        again: raised by a reset and the legal actions after it.
    """

    is_legal: bool
    case: str
    action: Mapping[Any, Any]
    raised: str | None
    reward: float | None
    legal_reward: float | None
    is_over: bool
    again: str | None


@dataclass(frozen=True, slots=True)
class EndedActions:
    """Agents that have ended, and the first turn that their actions changed; None: they didn't."""

    agents: list[Any]
    turn: int | None


@dataclass(frozen=True, slots=True)
class MaskTrial:
    """Every action of an agent with a mask, or some of very many, tried at one turn.

    Attributes:
        agent: as the environment calls it.
        actions: those that were tried.
        given: for each, whether the mask allows it.
        classes: for each the number of its outcome, equal for equal ones; -1: the step raised.
        others: the same flags as other masks have them, by the words for their source.
    """

    agent: Any
    actions: tuple[Any, ...]
    given: tuple[bool, ...]
    classes: tuple[int, ...]
    others: Mapping[str, tuple[bool, ...]]

    def is_alone(self, place: int) -> bool:
        """Tells whether no other action gives what this one does."""
        return self.classes[place] >= 0 and self.classes.count(self.classes[place]) == 1
