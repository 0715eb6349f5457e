"""Legal actions of an agent now, and perturbations that carry out others than it chose."""

import copy
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from gymnasium.spaces import Discrete, MultiDiscrete, Space
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.episodes.agent_spec import as_action
from gamekeeper.interface.action_mask import for_sample, legal_flags, reader
from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.intervention import Hooks
from gamekeeper.rollouts.interventions.perturbation import (
    Perturbation,
    PerturbationHooks,
    action_space,
)
from gamekeeper.rollouts.interventions.value_parts import (
    PartNumbers,
    ValuePart,
    are_numbers,
    blank_of_rare,
    parts_of,
    scalar_like,
)

Flags = NDArray[np.bool_]


class LegalActions:
    """An agent's actions, as its space, its noop and its mask of the moment leave them.

    A mask counts for Discrete spaces and for MultiDiscrete ones of one axis, also within others;
    elsewhere, and where a mask leaves nothing, all is legal.

    Attributes:
        has_noop: an action that does nothing is declared, and is one of the space's.
    """

    def __init__(self, contract: Contract, agent: AgentId, space: Space[Any]) -> None:
        self.space, self.parts = space, tuple(parts_of(space))
        self._read = reader(contract.mask_of(agent))
        self._noop = _noop(contract, agent, space)
        self.has_noop = self._noop is not None
        self._mask: Any = None

    def take(self, observation: Any, info: Any) -> None:
        """Notes the mask in what the agent is given now."""
        self._mask = self._read(observation, info)

    def flags(self, part: ValuePart) -> tuple[Flags, ...] | None:
        """Legal values of a part, for each of its whole numbers; None: all."""
        mask = self._mask
        for key in part.path:
            if isinstance(mask, Mapping):
                mask = mask.get(key)
            else:
                is_item = isinstance(mask, tuple | list) and isinstance(key, int)
                mask = mask[key] if is_item and key < len(mask) else None
        if mask is None:
            return None
        if isinstance(part.space, Discrete):
            flags = legal_flags(mask, int(part.space.n))
            return (flags,) if flags.any() else None
        if isinstance(part.space, MultiDiscrete) and part.space.nvec.ndim == 1:
            return tuple(np.asarray(each, bool) for each in for_sample(part.space, mask))
        return None

    def allows(self, action: Any) -> bool:
        """Tells whether an action of the space is legal now."""
        if self._mask is None:
            return True
        for part in self.parts:
            flags = self.flags(part)
            if flags is None:
                continue
            if isinstance(part.space, Discrete):
                if not flags[0][int(part.of(action)) - int(part.space.start)]:
                    return False
                continue
            first = np.asarray(getattr(part.space, "start", 0)).reshape(-1)
            chosen = np.asarray(part.of(action)).reshape(-1) - first
            if not all(flag[int(at)] for flag, at in zip(flags, chosen, strict=True)):
                return False
        return True

    def noop(self, like: Any) -> Any:
        """The action that does nothing, new at every call, of the type of another."""
        if isinstance(self.space, Discrete):
            return scalar_like(like, self._noop)
        return copy.deepcopy(self._noop)

    def stand_in(self, like: Any) -> Any:
        """Action in place of an illegal one, by one rule for all.

        The declared noop where that is legal; else part by part the first legal number, of a Box
        0 or what is nearest to it.

        Args:
            like: what the agent has chosen, whose types are kept, and whose texts stay.
        """
        if self.has_noop:
            noop = self.noop(like)
            if self.allows(noop):
                return noop
        action = like
        for part in self.parts:
            action = self._first(part, action)
        return action

    def _first(self, part: ValuePart, action: Any) -> Any:
        if not are_numbers(part.space):
            return part.put(action, blank_of_rare(part.space, part.of(action)))
        numbers, flags = PartNumbers(part), self.flags(part)
        if numbers.read(action) is None:
            return action
        if flags is not None:
            return numbers.write(action, numbers.low + [float(np.argmax(x)) for x in flags])
        is_listed = isinstance(part.space, Discrete | MultiDiscrete)
        return numbers.write(action, numbers.low if is_listed else numbers.blank())


def legal_actions_of(contract: Contract, env: Any, agent: AgentId) -> LegalActions | None:
    """Actions that an agent may take; None where the environment doesn't say."""
    space = action_space(env, agent)
    return None if space is None else LegalActions(contract, agent, space)


def _noop(contract: Contract, agent: AgentId, space: Space[Any]) -> Any:
    declared = contract.noop_of(agent)
    if declared is None:
        return None
    try:
        return as_action(space, declared)
    except ValueError:  # what is declared is no action: as if none were
        return None


Actuator = Callable[[Any], Any]
"""From what was chosen to what is done; called once at each of an agent's turns."""


@dataclass(frozen=True, slots=True)
class ActionPerturbation(Perturbation):
    """Gives each agent an actuator, which carries out something else than the agent chose.

    An actuator's action in place of the chosen one, where it isn't legal now, gives way to the
    stand-in of `LegalActions`: the declared noop, else the first legal action.
    """

    ON: ClassVar[Literal["seen", "done"]] = "done"

    def start(self, rng: Generator) -> Hooks:
        """Returns the hooks for one episode."""
        return _ActionHooks(self, rng) if self.strength else Hooks()

    @abstractmethod
    def actuator(self, legal_actions: LegalActions, rng: Generator) -> Actuator:
        """Returns the actuator of an agent for one episode; the chosen action stays as it is."""

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not where the environment doesn't say what an agent may do."""
        legal_actions = legal_actions_of(contract, env, agent)
        if legal_actions is None:
            return "the environment doesn't say what it may do"
        return cls.lacks(legal_actions)

    @classmethod
    def lacks(cls, legal_actions: LegalActions) -> str | None:
        """Returns why an agent's actions can't be perturbed like that; None where they can."""
        return None


class _ActionHooks(PerturbationHooks):
    """Hooks that give each agent an actuator when it first acts."""

    wants_given = True

    def __init__(self, perturbation: ActionPerturbation, rng: Generator) -> None:
        super().__init__(perturbation, rng)
        self._actuator = perturbation.actuator
        self._actuators: dict[AgentId, tuple[LegalActions, Actuator] | None] = {}

    def given(self, turn: int, agent: AgentId, observation: Any, info: Any) -> None:
        """Notes the mask."""
        found = self._of(agent)
        if found is not None:
            found[0].take(observation, info)

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """Actions as the agents' actuators carry them out; ended agents have none."""
        return {
            agent: None if action is None else self._done(agent, action)
            for agent, action in actions.items()
        }

    def _done(self, agent: AgentId, action: Any) -> Any:
        found = self._of(agent)
        if found is None:
            return action
        legal_actions, actuator = found
        done = actuator(action)
        return (
            done if done is action or legal_actions.allows(done) else legal_actions.stand_in(action)
        )

    def _of(self, agent: AgentId) -> tuple[LegalActions, Actuator] | None:
        if agent not in self._actuators:
            legal_actions = (
                legal_actions_of(self.contract, self.env, agent) if self.is_meant(agent) else None
            )
            actuator = (
                None
                if legal_actions is None
                else (legal_actions, self._actuator(legal_actions, self.stream(agent)))
            )
            self._actuators[agent] = actuator
        return self._actuators[agent]
