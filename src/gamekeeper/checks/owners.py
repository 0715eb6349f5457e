"""Owners: whose reward, ending and numbers of the observation an agent's action moves."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from gamekeeper.checks.effects import MOST_PLACES, by_turn, changed_numbers, numbers_in
from gamekeeper.checks.facts.form_facts import EpisodeShape, MoveTrial
from gamekeeper.checks.probe_evidence import Fact, ProbeCounterfactual, ProbeEvidence
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.where import Where

LEAST: Final = 3
"""Replaced actions of each agent that moved something of its owner."""
MOST_OTHERS: Final = 0.1
"""Part of these that may have moved it elsewhere, by what agents do to each other."""


@dataclass(frozen=True, slots=True)
class OwnerTrial:
    """One agent's action, replaced by another one."""

    where: Where
    turn: int
    choice: Any


@dataclass(slots=True)
class Owners:
    """For each pair of agents, how often an action of the first moved something of the second.

    Attributes:
        agents: all that were live at the reset.
        counts: by pair.
        trials: the first action that moved it, by pair.
    """

    agents: Sequence[str]
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    trials: dict[tuple[str, str], OwnerTrial] = field(default_factory=dict)

    def note(self, agent: str, moved: Sequence[str], trial: OwnerTrial) -> None:
        """Notes the agents of which an action moved something."""
        for other in moved:
            self.counts[agent, other] += 1
            self.trials.setdefault((agent, other), trial)

    def by_agent(self) -> dict[str, str]:
        """For each agent the one of which its actions move something, a different one for each.

        It is empty where that is seen of fewer than two agents or half of them, or where an agent's
        actions move something of several.
        """
        known, moved = frozenset(self.agents), defaultdict[str, list[tuple[int, str]]](list)
        for (agent, other), count in self.counts.items():
            if other in known:
                moved[agent].append((count, other))
        found = {}
        for agent in self.agents:
            counts = sorted(moved[agent], reverse=True)
            if counts and counts[0][0] >= LEAST:
                found[agent] = counts[0][1]
                if len(counts) > 1 and counts[1][0] > MOST_OTHERS * counts[0][0]:
                    return {}
        is_enough = len(found) >= max(2, len(self.agents) / 2)
        return found if is_enough and len(set(found.values())) == len(found) else {}


@dataclass(frozen=True, slots=True)
class Doings:
    """Effects of replaced actions while all agents were live.

    Attributes:
        rewards: of the step.
        endings: of one agent alone.
        places: by place, numbers of what agents observe next.
    """

    rewards: Owners
    endings: Owners
    places: Mapping[int, Owners]

    def shown(self) -> dict[int, dict[str, str]]:
        """Owners of the numbers that have any, by place."""
        found = {place: each.by_agent() for place, each in self.places.items()}
        return {place: owners for place, owners in sorted(found.items()) if owners}


def is_own(owners: Mapping[str, str]) -> bool:
    """Tells whether each agent's actions move its own."""
    return bool(owners) and all(agent == owner for agent, owner in owners.items())


def is_crossed(owners: Mapping[str, str]) -> bool:
    """Tells whether each agent's actions move another one's."""
    return bool(owners) and all(agent != owner for agent, owner in owners.items())


def left_at(episode: Episode, turn: int) -> list[str]:
    """The agents of the reset that haven't ended at the start of a turn, in their order."""
    first = episode.turns[0]
    ended = {name for each in episode.turns if each.index <= turn for name in each.ended}
    left = first.live - ended
    return [name for name in first.agents if name in left]


def doings(evidence: ProbeEvidence) -> Doings:
    """Owners of rewards, of endings, and of each place of observations.

    Rewards and endings are also those of the probe `form`, which replaces many more actions.
    """
    trials = [each for each in evidence.counterfactuals("influence") if each.noise is None]
    shapes = {fact.where.play: fact.value for fact in evidence.facts(EpisodeShape)}
    rosters = [*(each.base.turns[0].live for each in trials), *(s.first for s in shapes.values())]
    roster = sorted(rosters[0]) if rosters else []
    found = Doings(Owners(roster), Owners(roster), defaultdict(lambda: Owners(roster)))
    for trial in trials:
        agent, turn = agent_name(trial.change["agent"]), int(trial.change["turn"])
        base, changed = (by_turn(each, turn) for each in (trial.base, trial.episode))
        if turn not in base or turn not in changed or sorted(left_at(trial.base, turn)) != roster:
            continue
        choice = changed[turn].actions.get(agent, trial.change["action"])
        replaced = OwnerTrial(trial.base.at(turn, agent, "actions"), turn, choice)
        one, two = base[turn].rewards, changed[turn].rewards
        moved = [n for n in roster if one.get(n, 0.0) != two.get(n, 0.0)]
        found.rewards.note(agent, moved, replaced)
        if turn + 1 in base and turn + 1 in changed:
            ended = [*(base[turn + 1].ended ^ changed[turn + 1].ended)]
            found.endings.note(agent, ended if len(ended) == 1 else [], replaced)
        for other in roster:
            for place in _moved_places(trial, base, changed, other):
                found.places[place].note(agent, [other], replaced)
    for fact in evidence.facts(MoveTrial):
        if fact.where.play in shapes:
            _note_moves(found, fact, shapes[fact.where.play])
    return found


def _note_moves(found: Doings, fact: Fact[MoveTrial], shape: EpisodeShape) -> None:
    """Notes whose reward and ending of its own step a replaced move changed."""
    trial, roster = fact.value, found.rewards.agents
    looks = [each for each in trial.looks if each.turn == trial.turn]
    paid = {each.target: each.is_changed for each in looks if each.on == "reward"}
    has_ended = any(ending.step < trial.turn for ending in shape.endings)
    if trial.is_shifted or has_ended or sorted(shape.first) != roster or set(roster) - set(paid):
        return
    where = replace(fact.where, agent=trial.agent, field="actions")
    replaced = OwnerTrial(where, trial.turn, trial.choice)
    found.rewards.note(trial.agent, [name for name in roster if paid[name]], replaced)
    ended = [each.target for each in looks if each.on == "ending" and each.is_changed]
    found.endings.note(trial.agent, ended if len(ended) == 1 else [], replaced)


def _moved_places(
    trial: ProbeCounterfactual, base: Mapping[int, Turn], changed: Mapping[int, Turn], agent: str
) -> frozenset[int]:
    """Places that differ in what an agent observes first after the step."""
    start, later = int(trial.change["turn"]), int(trial.change["later"])
    for turn in range(start + 1, start + later + 2):
        one, two = (_seen(each.get(turn), agent) for each in (base, changed))
        if one is not None and two is not None:
            return changed_numbers(one, two) if len(one) <= MOST_PLACES else frozenset()
    return frozenset()


def _seen(turn: Turn | None, agent: str) -> Any:
    """Numbers of what an agent observed; None where it didn't."""
    if turn is None or not turn.has_observation(agent):
        return None
    return numbers_in(turn.observations[agent])
