"""Check of whose observation `observe(agent)` gives while another agent is in turn."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gamekeeper.checks.check import HIGH, Case, Cases, check
from gamekeeper.checks.effects import MOST_PLACES, numbers_in
from gamekeeper.checks.facts.space_facts import OthersView
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.spaces.observation_origin import numbers
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode
from gamekeeper.statistics.significance import FloatArray

LEAST_VIEWS: Final = 20
LEAST_EPISODES: Final = 4
LEAST_CHANGES: Final = 20
MOST_OWN: Final = 0.5
"""Changes from an agent's turn to its next one, for each from a turn to another agent's."""
STEADY: Final = 0.9
"""Part of the episodes in which agents' own numbers stay more often than those of their turns."""


def unmasked(value: Any) -> Any:
    """The observation without its action mask."""
    if isinstance(value, dict):
        return {key: part for key, part in value.items() if key != "action_mask"}
    return value


def assert_observes_its_own(
    make: Any, seed: Any, actions: Any, turns: Any, agent: Any, place: int
) -> None:
    """Raises where observe() gives a number of the agent in turn, between two of its own."""
    env, seen, others = make(), [], []
    env.reset(seed=seed)
    for turn in range(turns[-1] + 1):
        if turn in turns:
            asked = next(each for each in env.agents if str(each) == agent)
            seen.append(numbers(unmasked(env.observe(asked)))[place])
            others.append(numbers(unmasked(env.observe(env.agent_selection)))[place])
        if turn < turns[-1]:
            env.step(actions[turn])
    first, between, last = seen
    is_own = first != last or between == first or between != others[1]
    assert is_own, f"{agent} observes {first}, then {between}, as the agent in turn, then {last}"


@dataclass(frozen=True, slots=True)
class _Turns:
    """Observations of an episode, a row for each turn of a live agent.

    Attributes:
        turns: their numbers.
        agents: in turn.
        rows: [turns, places] what each observed.
        before: for each row that of its agent's turn before; -1: it is the first.
    """

    episode: Episode
    turns: Sequence[int]
    agents: Sequence[str]
    rows: FloatArray
    before: Sequence[int]

    def pairs(self) -> list[int]:
        """Rows whose agent had a turn before, and that follow another agent's."""
        at = range(1, len(self.agents))
        return [k for k in at if self.before[k] >= 0 and self.agents[k - 1] != self.agents[k]]


@check(
    "GK219",
    HIGH,
    "spaces",
    "rollout",
    api="aec",
    confidence=0.9,
    looks_at="numbers that all agents observe alike at every turn, in four episodes of several "
    "turns of each agent",
    doubt="the environment may mean to show all agents what the one in turn has",
)
def observe_is_of_its_agent(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`observe(agent)` gives the observation of that agent, whoever is in turn.

    An agent's last observation, and all that a conversion to the Parallel API gives, is another
    one's: hidden hands are shown to all.

    Judged by numbers that are alike in the observations of all agents at every turn, those of
    action masks left out. What is public stays from turn to turn. It is broken only where such
    numbers belong to the agent in turn instead: from one of its turns to its next they change at
    most half as often as from one turn to another agent's, and what agents have there together is
    drawn anew in episodes, so that it doesn't just tell which agent is in turn.

    It is only suspected, as an environment may mean to show all agents what the one in turn has.

    Bad: `return self.hand[self.agent_selection]`.

    Good: `return self.hand[agent]`.

    Fix: let observe(agent) look up its argument, never agent_selection
    """
    common = _common(evidence)
    if common is None or not len(common):
        return
    played = [each for episode in evidence["rollout"] if (each := _played(episode)) is not None]
    played = [each for each in played if each.pairs() and each.rows.shape[1] > common.max()]
    if len({each.episode.seed for each in played}) < LEAST_EPISODES:
        return
    own = _of_the_mover(played, common)
    is_drawn = len({_together(each, own) for each in played}) >= LEAST_EPISODES
    broken = next(filter(None, (_shown(each, own) for each in played)), None) if is_drawn else None
    for each in played if broken is None else ():
        yield Case(each.episode.at(each.turns[-1], each.agents[-1], "observe"), True)
    if broken is not None:
        each, (first, between, last), place = broken
        agent, mover = each.agents[last], each.agents[between]
        turns = [each.turns[k] for k in (first, between, last)]
        expected = f"at turn {turns[1]} its own observation, as at turns {turns[0]} and {turns[2]}"
        seen = f"observe({agent!r}) gives number {place} of {mover!r}, which is in turn"
        proof = reproducer_of(assert_observes_its_own, turns=turns, agent=agent, place=int(place))
        yield Case(each.episode.at(turns[-1], agent, "observe"), False, expected, seen, proof)


def _common(evidence: ProbeEvidence) -> Any:
    """Places of numbers that no other agent observed otherwise than the one in turn.

    A number that was the same for all agents in turn, such as that of a rare card, decides nothing.
    """
    views = [each.value for each in evidence.facts(OthersView) if each.value.failed is None]
    sizes = {each.size for each in views}
    if len(views) < LEAST_VIEWS or len(sizes) != 1 or not 0 < min(sizes) <= MOST_PLACES:
        return None
    differ = {place for each in views for place in each.differs}
    moved = {place for each in views for place in each.moved}
    return np.array([place for place in sorted(moved - differ) if place < min(sizes)], int)


def _played(episode: Episode) -> _Turns | None:
    """Observations of the agents in turn; None where that has several sizes."""
    seen = [
        (turn.index, agent, numbers_in(unmasked(turn.observations[agent])))
        for turn in episode.turns
        for agent in turn.order
        if agent in turn.observations and agent not in turn.ended
    ]
    if len({len(row) for *_, row in seen}) != 1:
        return None
    turns, agents, rows = zip(*seen, strict=True)
    last: dict[str, int] = {}
    before = []
    for place, agent in enumerate(agents):
        before.append(last.get(agent, -1))
        last[agent] = place
    return _Turns(episode, turns, agents, np.stack(rows), before)


def _of_the_mover(played: Sequence[_Turns], common: Any) -> Any:
    """Places of the numbers that belong to the agent in turn; none where that isn't steady."""
    own = np.stack([_changes(each, [each.before[k] for k in each.pairs()]) for each in played])
    near = np.stack([_changes(each, [k - 1 for k in each.pairs()]) for each in played])
    is_own = near.sum(axis=0) >= np.maximum(LEAST_CHANGES, own.sum(axis=0) / MOST_OWN)
    places = [place for place in common if is_own[place]]
    is_steady = own[:, places].sum(axis=1) < near[:, places].sum(axis=1)
    return places if is_steady.mean() >= STEADY else []


def _changes(each: _Turns, to: Sequence[int]) -> Any:
    """[places] how many pairs differ from the rows beside them."""
    return (each.rows[each.pairs()] != each.rows[to]).sum(axis=0)


def _together(each: _Turns, places: Sequence[int]) -> frozenset[tuple[float, ...]]:
    """Values of the agents at some places in their first turns."""
    firsts = [k for k, before in enumerate(each.before) if before < 0]
    return frozenset(tuple(each.rows[k, places].tolist()) for k in firsts)


def _shown(each: _Turns, places: Sequence[int]) -> tuple[_Turns, tuple[int, int, int], int] | None:
    """The first row between two of one agent that are alike in a place, and it isn't."""
    for last in each.pairs():
        first = each.before[last]
        for place in places:
            column = each.rows[:, place]
            if column[first] == column[last]:
                between = [k for k in range(first + 1, last) if column[k] != column[first]]
                if between:
                    return each, (first, between[0], last), place
    return None
