"""Replaced moves, read: influence between agents, and what later agents of a round find otherwise.

Every look stands against the unchanged rerun, and stops where that differs. Pure.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from gamekeeper.checks.effects import influence_rows
from gamekeeper.checks.facts.form_facts import MoveLook, MoveTrial
from gamekeeper.checks.probe_evidence import Fact
from gamekeeper.episodes.layout import role

FEWEST: Final = 30
"""Looks without a hit that count as none: the share is below 0.12 then (Wilson, 95 %)."""
ONE_WAY: Final = 3
"""Hits one way, with none back, for a word on the order deciding rewards."""
NEAR: Final = 1
"""Lags up to which looks without a hit are listed too."""

Trials = Sequence[Fact[MoveTrial]]


@dataclass(slots=True)
class Within:
    """Looks at later agents of the round of a replaced move, for one reason.

    Attributes:
        shown: the first effect with its two turns, in words; empty where there is none.
        roles: in which one agent's move reached another of the same role.
    """

    looks: int = 0
    hits: int = 0
    shown: str = ""
    roles: set[str] = field(default_factory=set)

    def add(self, look: MoveLook, fact: Fact[MoveTrial]) -> None:
        """Counts one look."""
        self.looks += 1
        if look.is_changed:
            self.hit(look, fact)

    def hit(self, look: MoveLook, fact: Fact[MoveTrial]) -> None:
        """Notes that the move reached the target."""
        trial = fact.value
        self.hits += 1
        if role(trial.agent) == role(look.target):
            self.roles.add(role(trial.agent))
        self.shown = self.shown or (
            f"{trial.agent}'s move at turn {trial.turn} of episode {fact.where.play} of probe "
            f"{fact.where.probe} changes {look.target}'s {look.on} at turn {look.turn}"
        )


def influence(trials: Trials) -> list[dict[str, Any]]:
    """The share of replaced moves that changed something, by pair, place and lag in rounds."""
    looks: Counter[tuple[str, str, str, int]] = Counter()
    hits: Counter[tuple[str, str, str, int]] = Counter()
    for fact in trials:
        seen: dict[tuple[str, str, str, int], bool] = {}  # a round of turns has several looks
        for trial, look in _all([fact]):
            key = trial.agent, look.target, str(look.on), look.lag
            seen[key] = seen.get(key, False) or look.is_changed
        looks.update(seen.keys())
        hits.update(seen)
    listed = {key: count for key, count in looks.items() if hits[key] or key[3] <= NEAR}
    return influence_rows(listed, hits)


def is_observed_at_once(trials: Trials) -> bool:
    """Tells whether a replaced move changed what its own step lets some agent observe."""
    return any(
        look.is_changed and look.on == "observation" and look.lag <= NEAR
        for _, look in _all(trials)
    )


def between_agents(trials: Trials) -> tuple[int, int]:
    """Looks at other agents, and those that found a change."""
    found = [look.is_changed for trial, look in _all(trials) if look.target != trial.agent]
    return sum(found), len(found)


def pairs(trials: Trials) -> list[dict[str, Any]] | None:
    """Roles whose moves change rewards of which role, the least lag.

    None of too few looks, or where moves were seen to change no reward.
    """
    least: dict[tuple[str, str, bool], int] = {}
    count = 0
    for trial, look in _all(trials):
        if look.on == "reward":
            count += 1
            if look.is_changed:
                key = role(trial.agent), role(look.target), trial.agent == look.target
                least[key] = min(look.lag, least.get(key, look.lag))
    if count < FEWEST or not least:
        return None
    return [
        {"from": one, "to": two, "own": own, "lag": lag}
        for (one, two, own), lag in sorted(least.items())
    ]


def messages(trials: Trials) -> dict[str, dict[str, Any]] | None:
    """By role, whether its whole action is a message: it changes what others observe, no more.

    A role's moves are messages where replaced ones changed observations of another agent, and
    nothing else: no reward, ending or mask, and no observation of their own agent. `n` counts the
    looks at these in the round in which the message was first observed; a role with fewer than 30
    has no entry. One part of an action isn't replaced by itself, so that words beside a move aren't
    seen, nor are effects later than the rounds that are looked ahead.
    """
    looks: Counter[tuple[str, int]] = Counter()
    acted: set[str] = set()
    heard: dict[str, set[str]] = {}
    first: dict[str, int] = {}
    for trial, look in _all(trials):
        name = role(trial.agent)
        is_heard = look.on == "observation" and look.target != trial.agent
        if not is_heard:
            looks[name, look.lag] += 1
        if is_heard and look.is_changed:
            heard.setdefault(name, set()).add(role(look.target))
            first[name] = min(look.lag, first.get(name, look.lag))
        elif look.is_changed:
            acted.add(name)
    found = {}
    for name in sorted({name for name, _ in looks}):
        count = looks[name, first.get(name, 0)]
        if count >= FEWEST:
            to = sorted(heard.get(name, ()))
            found[name] = {"message": bool(to) and name not in acted, "to": to, "n": count}
    return found or None


def legality(trials: Trials) -> bool | None:
    """Tells whether moves change masks of others; None of too few looks."""
    looks = [
        look.is_changed
        for trial, look in _all(trials)
        if look.on == "mask" and look.target != trial.agent
    ]
    if any(looks):
        return True
    if not looks:
        return False if len(trials) >= FEWEST else None
    return None if len(looks) < FEWEST else False


def within_rounds(trials: Trials) -> dict[str, Within]:
    """Looks at later agents of a round by reason: `state`, `legality` and `reward`.

    Reward: only where the order decides it. A move is paid at a later agent's turn while others
    are still to move, so moves take effect one by one; or it changes what a later agent is paid,
    and never the reverse: between agents of a role, or where the first is paid at its own turn.
    Rewards after a move that changed how many random numbers are drawn are left out: it changes
    what is drawn for later moves.
    """
    found = {"state": Within(), "legality": Within(), "reward": Within()}
    names = {"observation": "state", "mask": "legality"}
    for fact in trials:
        trial = fact.value
        for look in trial.looks:
            if look.target == trial.agent or look.lag:
                continue
            if look.on == "reward" and trial.is_shifted:
                continue
            if look.on in names:
                found[names[look.on]].add(look, fact)
            elif look.on == "reward" and look.turn > trial.turn and len(trial.movers) > 1:
                found["reward"].looks += 1
                if look.is_early and look.is_changed:
                    found["reward"].hit(look, fact)
    for fact, look in _one_way([fact for fact in trials if not fact.value.is_shifted]):
        found["reward"].hit(look, fact)
    return found


def _one_way(trials: Trials) -> Iterator[tuple[Fact[MoveTrial], MoveLook]]:
    """Yields effects on what a later agent of a round is paid, of pairs without the reverse."""
    there: dict[tuple[str, str], list[tuple[Fact[MoveTrial], MoveLook]]] = {}
    back: dict[tuple[str, str], list[bool]] = {}
    prompt: set[str] = set()
    for fact in trials:
        trial = fact.value
        at = {name: place for place, name in enumerate(trial.movers)}
        for look in trial.looks:
            if look.on != "reward" or look.lag or look.target not in at:
                continue
            if look.target == trial.agent:
                if look.is_changed and look.is_early and look.turn == trial.turn:
                    prompt.add(trial.agent)
            elif at[trial.agent] < at[look.target]:
                if look.is_changed and look.turn > trial.turn:
                    there.setdefault((trial.agent, look.target), []).append((fact, look))
            else:
                back.setdefault((look.target, trial.agent), []).append(look.is_changed)
    for pair, effects in there.items():
        is_one_way = len(back.get(pair, ())) >= FEWEST and not any(back[pair])
        is_alike = role(pair[0]) == role(pair[1]) or pair[0] in prompt
        if len(effects) >= ONE_WAY and is_one_way and is_alike:
            yield from effects


def one_way_pairs(trials: Trials) -> list[tuple[str, str]]:
    """Pairs of a role of which, in one round, one's move changed the other's reward alone."""
    return [
        (one, two)
        for tried in _paid_at_once(trials)
        for one, reached in tried.items()
        for two in sorted(reached)
        if two != one and two in tried and one not in tried[two] and role(one) == role(two)
    ]


def contests(trials: Trials) -> int:
    """Number of pairs of which, in one round, each one's move changed the other's reward."""
    return sum(
        one < two and one in tried.get(two, ())
        for tried in _paid_at_once(trials)
        for one, reached in tried.items()
        for two in reached
    )


def _paid_at_once(trials: Trials) -> list[dict[str, set[str]]]:
    """By round and agent, whose rewards of that round its move changed."""
    rounds: dict[tuple[int, int], dict[str, set[str]]] = {}
    for fact in trials:
        trial = fact.value
        rounds.setdefault((fact.where.play, trial.round), {})[trial.agent] = {
            look.target
            for look in trial.looks
            if look.on == "reward" and look.lag == 0 and look.is_changed
        }
    return list(rounds.values())


def _all(trials: Iterable[Fact[MoveTrial]]) -> Iterator[tuple[MoveTrial, MoveLook]]:
    for fact in trials:
        for look in fact.value.looks:
            yield fact.value, look
