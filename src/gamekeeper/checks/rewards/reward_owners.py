"""Check of whose rewards are whose once agents have left."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, Case, Cases, check
from gamekeeper.checks.effects import by_turn
from gamekeeper.checks.facts.form_facts import EpisodeShape, MoveTrial
from gamekeeper.checks.owners import doings, is_crossed, is_own, left_at
from gamekeeper.checks.probe_evidence import Fact, ProbeCounterfactual, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.where import Where

LEAST_OWN: Final = 10
"""Replaced actions, at other times, that moved their own agent's reward alone."""
LEAST_SHIFTED: Final = 4
"""Replaced actions, as or after some have left, that moved the reward that a shift predicts."""


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
        where: episode, turn and agent.
        choice: the other action.
        when: `whole` (no agent has left), `leaving` (some leave in the step), `left`.
        moved: agents whose rewards it moved.
        shifted: agent that a shift by those who left predicts; the agent itself where it is none.
    """

    where: Where
    agent: str
    turn: int
    choice: Any
    when: str
    moved: frozenset[str]
    shifted: str


@check(
    "GK415",
    HIGH,
    "influence",
    "form",
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
    each its own agent's and nobody else's; and once some have left, or in the steps in which they
    do, each that moved a reward moved just one, that of the agent to which such a shift leads, four
    of them another agent's.

    Bad:
        rewards = {a: self.paid[i] for i, a in enumerate(self.agents)}     # paid: of all agents

    Good:
        rewards = {a: self.paid[self.possible_agents.index(a)] for a in self.agents}

    Fix: look rewards up by the agent's name, or by its place in possible_agents, never by its place
    among the agents that are left
    """
    found = _found(evidence)
    whole = [each for each in found if each.when == "whole"]
    if not whole or any(each.moved != {each.agent} for each in whole):
        return
    for when in ("leaving", "left"):
        after = [each for each in found if each.when == when]
        wrong = [each for each in after if each.moved != {each.agent}]
        own = [each for each in found if each.when != when and each.moved == {each.agent}]
        is_enough = len(own) >= LEAST_OWN and len(wrong) >= LEAST_SHIFTED
        is_shift = is_enough and all(each.moved == {each.shifted} for each in after)
        yield from _shifts(wrong if is_shift else after, is_shift)


def _shifts(found: Sequence[_Paid], is_shift: bool) -> Cases:
    """Cases of replaced actions that moved rewards."""
    for each in found:
        is_ok = not is_shift
        seen = f"another action of {each.agent!r} moves the reward of {each.shifted!r} alone"
        proof = _proof(each.turn, each.choice, each.agent, each.shifted) if is_shift else None
        yield Case(each.where, is_ok, "its own reward, as while all were in the game", seen, proof)


def _found(evidence: ProbeEvidence) -> list[_Paid]:
    """Replaced actions that moved rewards of their step, of the probes `influence` and `form`."""
    trials = [each for each in evidence.counterfactuals("influence") if each.noise is None]
    shapes = {fact.where.play: fact.value for fact in evidence.facts(EpisodeShape)}
    moves = [each for each in evidence.facts(MoveTrial) if each.where.play in shapes]
    found = [_paid(each) for each in trials]
    found += [_paid_by_move(each, shapes[each.where.play]) for each in moves]
    return [each for each in found if each is not None]


def _paid(trial: ProbeCounterfactual) -> _Paid | None:
    """Rewards of its own step that a replaced action moved; None where it moved none."""
    agent, turn = agent_name(trial.change["agent"]), int(trial.change["turn"])
    one, two = (by_turn(each, turn).get(turn) for each in (trial.base, trial.episode))
    if one is None or two is None:
        return None
    names = one.rewards.keys() | two.rewards.keys()
    moved = frozenset(n for n in names if one.rewards.get(n, 0.0) != two.rewards.get(n, 0.0))
    roster, left = left_at(trial.base, 0), left_at(trial.base, turn)
    then, other = (left_at(each, turn + 1) for each in (trial.base, trial.episode))
    if then != other or not set(one.live) <= set(roster):
        return None
    choice = two.actions.get(agent, trial.change["action"])
    where = trial.base.at(turn, agent, "rewards")
    return _placed(where, agent, turn, choice, moved, (roster, left, then))


def _paid_by_move(fact: Fact[MoveTrial], shape: EpisodeShape) -> _Paid | None:
    """The same of a replaced move of the probe `form`."""
    trial, roster = fact.value, list(shape.first)
    looks = [each for each in trial.looks if each.turn == trial.turn]
    paid = {each.target: each.is_changed for each in looks if each.on == "reward"}
    gone = ({e.agent for e in shape.endings if e.step < trial.turn + k} for k in (0, 1))
    left, then = ([n for n in roster if n not in ended] for ended in gone)
    ends_alike = not any(each.is_changed for each in looks if each.on == "ending")
    is_other = any(number < trial.round for _, number in (*shape.joined, *shape.left))
    if trial.is_shifted or is_other or not ends_alike or set(left) - set(paid):
        return None
    moved = frozenset(name for name, is_changed in paid.items() if is_changed)
    where = replace(fact.where, agent=trial.agent, field="rewards")
    return _placed(where, trial.agent, trial.turn, trial.choice, moved, (roster, left, then))


def _placed(
    where: Where,
    agent: str,
    turn: int,
    choice: Any,
    moved: frozenset[str],
    rosters: tuple[Sequence[str], Sequence[str], Sequence[str]],
) -> _Paid | None:
    """Adds the agent that a shift by those who left predicts; None if no reward was moved.

    Args:
        rosters: agents of the reset, of the step's start, and of its end.
    """
    roster, left, then = rosters
    if not moved or agent not in left:
        return None
    if left != roster:
        place = roster.index(agent)
        shifted = left[place] if place < len(left) else ""
        return _Paid(where, agent, turn, choice, "left", moved, shifted)
    if then != left and agent in then:
        shifted = left[then.index(agent)]
        return _Paid(where, agent, turn, choice, "leaving", moved, shifted)
    return _Paid(where, agent, turn, choice, "whole", moved, agent) if then == left else None


def _proof(turn: int, choice: Any, agent: str, other: str) -> Reproducer:
    return reproducer_of(
        assert_pays_its_agent, compares=True, turn=turn, agent=agent, other=other, choice=choice
    )


@check(
    "GK416",
    HIGH,
    "influence",
    "form",
    confidence=0.8,
    looks_at="three replaced actions of each agent that move one and the same agent's reward of "
    "their step, and as many that move a number of the observation, or an ending, of their own "
    "agent alone",
    doubt="the environment may pay agents for what another one does",
)
def rewards_are_of_their_own_agent(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent is paid for what it does itself, not for what another agent does.

    A learner that is paid for another one's actions learns nothing of its own.

    Measured by intervention: one action is replaced, all others stay. It is broken only where each
    of these is seen, while all agents are in the game: the actions of every agent move the reward
    of one agent, another one for each, and hardly ever its own; and a number of the observations,
    or the ending, moves by the actions of its own agent alone, so that these tell whose doing it
    was; and no number shows every payee what it is paid for, as that of a gift does.

    It is only suspected, as an environment may mean to pay agents for what another one does.

    Bad:
        self.agent_selection = self._selector.next()
        self.rewards[self.agent_selection] += 1.0          # for what the last agent did

    Good:
        self.rewards[agent] += 1.0
        self.agent_selection = self._selector.next()

    Fix: look the agent that acts up once, at the beginning of the step, and pay that one
    """
    done = doings(evidence)
    paid = done.rewards.by_agent()
    told = [*done.shown().values(), done.endings.by_agent()]
    if not paid or not any(map(is_own, told)):
        return
    is_crossed_alone = is_crossed(paid) and paid not in told  # a payee that sees it is meant
    for agent, other in paid.items():
        trial = done.rewards.trials[agent, other]
        yield Case(
            replace(trial.where, field="rewards"),
            not is_crossed_alone,
            "its own reward moves, as its observation or its ending does",
            f"another action of {agent!r} moves the reward of {other!r} alone",
            _proof(trial.turn, trial.choice, agent, other) if is_crossed_alone else None,
        )
