"""Check of whose rewards are whose once agents have left."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from gamekeeper.checks.check import HIGH, Case, Cases, check
from gamekeeper.checks.effects import by_turn
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import agent_name

LEAST_WHOLE: Final = 10
"""Replaced actions, while all are there, that moved a reward."""
LEAST_SHIFTED: Final = 4
"""Replaced actions, after some have left, that moved the reward that a shift predicts."""


def assert_pays_its_agent(
    make: Any, seed: Any, actions: Any, turn: int, agent: Any, other: Any, choice: Any
) -> None:
    """Raises where another action of an agent moves another one's reward of the step, not its own.

    In an AEC environment the agent is the one in turn.
    """

    def paid(replaced: bool) -> Any:
        env = make()
        env.reset(seed=seed)
        for action in actions[:turn]:
            env.step(action)
        action = actions[turn]
        if replaced:
            action = {**action, agent: choice} if isinstance(action, dict) else choice
        out = env.step(action)
        return {str(a): float(r) for a, r in (out[1] if out else env.rewards).items()}

    one, two = paid(False), paid(True)
    is_shifted = one.get(agent) == two.get(agent) and one.get(other) != two.get(other)
    assert not is_shifted, f"an action of {agent} moves the reward of {other} alone"


@dataclass(frozen=True, slots=True)
class _Paid:
    """A replaced action that moved rewards of its own step.

    Attributes:
        moved: agents whose rewards it moved.
        shifted: agent that a shift by those who left predicts; the agent itself where it is none.
    """

    trial: ProbeCounterfactual
    agent: str
    turn: int
    moved: frozenset[str]
    shifted: str


@check(
    "GK415",
    HIGH,
    "influence",
    confidence=0.9,
    looks_at="ten replaced actions that move a reward of their own step while all agents are in "
    "the game, and four after some have left",
)
def rewards_stay_with_their_agents(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Once an agent has left, the others are still paid for their own actions, not a neighbour's.

    An array of rewards that is laid over the agents that are left is shifted by one place for each
    that has gone: from then on agents learn from another one's rewards.

    Measured by intervention: one action is replaced, all others stay. It is broken only where each
    of these is seen: while all are in the game, ten actions or more moved a reward of their step,
    each its own agent's and nobody else's; and once some have left, each that moved a reward moved
    just one, that of the agent to which such a shift leads, four of them another agent's.

    Bad:
        rewards = {a: self.paid[i] for i, a in enumerate(self.agents)}     # paid: of all agents

    Good:
        rewards = {a: self.paid[self.possible_agents.index(a)] for a in self.agents}

    Fix: look rewards up by the agent's name, or by its place in possible_agents, never by its place
    among the agents that are left
    """
    trials = [each for each in evidence.counterfactuals("influence") if each.noise is None]
    found = [paid for each in trials if (paid := _paid(each)) is not None]
    whole = [each for each in found if not _missing(each)]
    if not whole or any(each.moved != {each.agent} for each in whole):
        return
    after = [each for each in found if _missing(each)]
    wrong = [each for each in after if each.moved != {each.agent}]
    is_enough = len(whole) >= LEAST_WHOLE and len(wrong) >= LEAST_SHIFTED
    is_shift = is_enough and all(each.moved == {each.shifted} for each in after)
    for each in wrong if is_shift else after:
        yield Case(
            each.trial.base.at(each.turn, each.agent, "rewards"),
            not is_shift,
            "its own reward, as while all were in the game",
            f"another action of {each.agent!r} moves the reward of {each.shifted!r} alone",
            _proof(each) if is_shift else None,
        )


def _roster(trial: ProbeCounterfactual) -> Sequence[str]:
    """Agents at the reset, in their order."""
    first = trial.base.turns[0]
    return [name for name in first.agents if name in first.live]


def _missing(paid: _Paid) -> bool:
    """Tells whether an agent of the beginning had left before the step."""
    live = by_turn(paid.trial.base, paid.turn)[paid.turn].live
    return not set(_roster(paid.trial)) <= live


def _paid(trial: ProbeCounterfactual) -> _Paid | None:
    """Rewards of its own step that a replaced action moved; None where it moved none."""
    agent, turn = agent_name(trial.change["agent"]), int(trial.change["turn"])
    one, two = (by_turn(each, turn).get(turn) for each in (trial.base, trial.episode))
    if one is None or two is None:
        return None
    names = one.rewards.keys() | two.rewards.keys()
    moved = frozenset(n for n in names if one.rewards.get(n, 0.0) != two.rewards.get(n, 0.0))
    roster = _roster(trial)
    if not moved or agent not in roster or not set(one.live) <= set(roster):
        return None
    left = [name for name in roster if name in one.live]
    place = roster.index(agent)
    shifted = left[place] if place < len(left) else ""
    return _Paid(trial, agent, turn, moved, shifted)


def _proof(paid: _Paid) -> Any:
    change = paid.trial.change
    choice = by_turn(paid.trial.episode, paid.turn)[paid.turn].actions.get(
        paid.agent, change["action"]
    )
    return reproducer_of(
        assert_pays_its_agent,
        compares=True,
        turn=paid.turn,
        agent=paid.agent,
        other=paid.shifted,
        choice=choice,
    )
