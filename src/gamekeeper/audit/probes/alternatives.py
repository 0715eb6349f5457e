"""What else each agent could have done at the turn that paid a declared individual term.

Only where the contract declares a term that is paid to whoever earned it; else it costs nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.core.trace import Trace, Turn
from gamekeeper.run.changes.replaced_action import ReplacedAction
from gamekeeper.run.episode import Play, Played

SHARE: Final = 1.0
TURNS: Final = 16
"""Rounds of a play: each alternative plays it again up to the payment."""
MOST_PLAYS: Final = 24
EVENTS: Final = 2
"""Payments of one play that are looked into, of each term and sign."""
ALTERNATIVES: Final = 6


def individual_terms(contract: Contract) -> tuple[str, ...]:
    """The declared terms that are paid to the agent that earned them."""
    return tuple(
        name
        for name, term in contract.rewards.items()
        if term.kind == "individual" and term.payee == ("earner",)
    )


def paid(contract: Contract, turn: Turn, agent: str, term: str) -> float:
    """What the crossing paid the agent of that term; a single declared term is the whole reward."""
    if turn.terms:
        return turn.terms.get(agent, {}).get(term, 0.0)
    return turn.rewards.get(agent, 0.0) if len(contract.rewards) == 1 else 0.0


def plays(lab: Lab) -> Iterator[Play]:
    """Short plays, as long as there are declared terms to look at."""
    if not individual_terms(lab.contract):
        return
    scale = max(len(lab.agents), 1) if lab.api == "aec" else 1
    for k in range(MOST_PLAYS):
        yield Play(seed=lab.seed + k, stream=k, most_turns=TURNS * scale)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """A fact for each payment that was looked into.

    Facts:
        `payment`: a dictionary: `term`, `agent`, `amount`, and `movers`: by agent at which `turn`
            it acted, how many alternatives were `tried` and the first that made the payment
            smaller (`instead`, None where none did).
    """
    env = lab.env()
    base = lab.play(play, env, state=False)
    begun = lab.meter.steps
    looked: dict[tuple[str, bool], int] = {}
    for turn in base.trace.turns:
        for term in individual_terms(lab.contract):
            for agent in turn.agents:
                amount = paid(lab.contract, turn, agent, term)
                key = term, amount > 0
                if amount == 0 or looked.get(key, 0) >= EVENTS:
                    continue
                if lab.meter.steps - begun > lab.ration:
                    return
                looked[key] = looked.get(key, 0) + 1
                movers = _movers(lab, env, base, turn, agent, term, amount)
                value = {"term": term, "agent": agent, "amount": amount, "movers": movers}
                yield lab.fact("payment", value, turn=turn.index, agent=agent, field="rewards")


def _movers(
    lab: Lab, env: Any, base: Played, turn: Turn, payee: str, term: str, amount: float
) -> dict[str, dict[str, Any]]:
    """By agent, whether something else that it could have done makes the payment smaller."""
    found: dict[str, dict[str, Any]] = {}
    cut = (base.play.actions or ())[: turn.index + 1]
    short = replace(base.play, actions=cut, most_turns=len(cut))
    for agent, then in _last_acts(base.trace, turn.index).items():
        entry: dict[str, Any] = {"turn": then.index, "tried": 0, "instead": None}
        for action in _others(lab, agent, then):
            change = ReplacedAction(then.index, _own(base, agent), action)
            twin = lab.play(short, env, change=change, state=False)
            if twin.failed is not None:
                continue
            entry["tried"] += 1
            after = next((t for t in twin.trace.turns if t.index == turn.index), None)
            now = 0.0 if after is None else paid(lab.contract, after, payee, term)
            if abs(now) < abs(amount) and entry["instead"] is None:
                entry["instead"] = action
        found[agent] = entry
    return found


def _last_acts(trace: Trace, turn: int) -> dict[str, Turn]:
    """The last turn at which each agent acted, no later than `turn`."""
    found: dict[str, Turn] = {}
    for each in trace.turns:
        if each.index > turn:
            break
        found.update({a: each for a in each.order if each.actions.get(a) is not None})
    return found


def _others(lab: Lab, agent: str, turn: Turn) -> list[Any]:
    spec = lab.agents.get(agent)
    space = None if spec is None else spec.action_space
    if not isinstance(space, Discrete):
        return []
    choices = np.arange(int(space.n))
    mask = turn.masks.get(agent)
    if mask is not None and np.shape(mask) == choices.shape:
        choices = choices[np.asarray(mask).astype(bool)]
    choices = choices + int(space.start)
    return [space.dtype.type(c) for c in choices if c != int(turn.actions[agent])][:ALTERNATIVES]


def _own(base: Played, name: str) -> Any:
    """The agent as the environment calls it."""
    known = (agent for each in base.play.actions or () for agent in each)
    return next((agent for agent in known if agent_name(agent) == name), name)
