"""Actions that take the place of what policies choose: recorded, replaced, held, in unison."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.random import Generator

from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.intervention import Hooks, Intervention, PlacedHooks
from gamekeeper.rollouts.interventions.legal_actions import LegalActions, legal_actions_of


@dataclass(frozen=True, slots=True)
class Reenacted(Intervention):
    """Replays a script of actions for all agents but the free ones.

    An agent without a scripted action there chooses freely too. What is illegal now gives way to
    the declared noop, else to the first legal action.

    Attributes:
        free: agents who choose.
        script: turn by turn, by agent.
    """

    free: tuple[str, ...] = ()
    script: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode."""
        return _Scripted(self)


class _Scripted(PlacedHooks):
    wants_given = True

    def __init__(self, change: Reenacted) -> None:
        super().__init__()
        self._free, self._script = frozenset(change.free), change.script
        self._legal_actions: dict[AgentId, LegalActions | None] = {}

    def given(self, turn: int, agent: AgentId, observation: Any, info: Any) -> None:
        """Notes the mask."""
        if agent_name(agent) in self._free:
            return
        if agent not in self._legal_actions:
            self._legal_actions[agent] = legal_actions_of(self.contract, self.env, agent)
        legal_actions = self._legal_actions[agent]
        if legal_actions is not None:
            legal_actions.take(observation, info)

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """The script's actions where there are some."""
        if turn >= len(self._script):
            return actions
        script = self._script[turn]
        return {
            agent: action if action is None else self._done(script, agent, action)
            for agent, action in actions.items()
        }

    def _done(self, script: Mapping[str, Any], agent: AgentId, chosen: Any) -> Any:
        name = agent_name(agent)
        written = None if name in self._free else script.get(name)
        if written is None:
            return chosen
        legal_actions = self._legal_actions.get(agent)
        if legal_actions is None or legal_actions.allows(written):
            return copy.deepcopy(written)
        return legal_actions.stand_in(written)


@dataclass(frozen=True, slots=True)
class ReplacedAction(Intervention):
    """Replaces one agent's action at one turn; all others stay as recorded.

    Attributes:
        turn: at which; nothing changes where the agent doesn't act then.
        action: what it does instead.
    """

    turn: int
    agent: AgentId
    action: Any

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode."""
        return _Replaced(self)


class _Replaced(Hooks):
    def __init__(self, change: ReplacedAction) -> None:
        self._change = change

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        change = self._change
        if turn != change.turn or actions.get(change.agent) is None:
            return actions
        return {**actions, change.agent: change.action}


@dataclass(frozen=True, slots=True)
class Held(Intervention):
    """Repeats each action for some turns; only where every action is always legal.

    Attributes:
        turns: for how long, on average.
    """

    turns: int = 12

    def start(self, rng: Generator) -> Hooks:
        """An agent takes another action with probability 1 / turns."""
        return _Holding(rng, self.turns)


class _Holding(Hooks):
    def __init__(self, rng: Generator, turns: int) -> None:
        self._rng, self._turns = rng, turns
        self._held: dict[AgentId, Any] = {}

    def acts(self, turn: int, actions: Mapping[AgentId, Any]) -> dict[AgentId, Any]:
        """Actions that are held in place of the chosen ones."""
        done: dict[AgentId, Any] = {}
        for agent, action in actions.items():
            is_new = agent not in self._held or self._rng.random() * self._turns < 1
            if is_new and action is not None:
                self._held[agent] = action
            done[agent] = None if action is None else self._held[agent]
        return done


@dataclass(frozen=True, slots=True)
class InUnison(Intervention):
    """Gives all agents the action of one of them, drawn anew, at about every second turn.

    Only for agents of equal action spaces without masks. Two that do the same at once come into
    conflict far more often than two that draw: firing together, wanting one cell from both sides.
    """

    share: float = 0.5

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode."""
        return _Unison(self.share, rng)


class _Unison(Hooks):
    def __init__(self, share: float, rng: Generator) -> None:
        self._share, self._rng = share, rng

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        if not actions or self._rng.random() >= self._share:
            return actions
        leader = list(actions)[int(self._rng.integers(len(actions)))]
        return dict.fromkeys(actions, actions[leader])
