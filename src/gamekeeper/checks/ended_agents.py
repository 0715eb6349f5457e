"""Agents that have ended, rosters and ticks of an episode, turn by turn."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final

from gamekeeper.checks.facts.episode_facts import NearLimit, TurnRosters
from gamekeeper.checks.facts.surface_facts import ReturnedForms
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn

FLAGS: Final = ("terminated", "truncated")


def tells_both_flags(evidence: ProbeEvidence) -> bool:
    """Tells whether steps return both flags, and not all another form, of which GK110 tells.

    Where all do, a reading makes the flags up, and can't tell terminations from truncations.
    """
    steps = [wrong for fact in evidence.facts(ReturnedForms) for wrong in fact.value.calls[1:]]
    return not steps or not all(steps)


def ended_in(turn: Turn) -> frozenset[str]:
    """Agents whose flags are up at the turn's start, also where a flag is no bool."""
    nonconforming = {
        agent
        for agent, fields in turn.nonconforming.items()
        if any(is_up(fields.get(name, {}).get("value")) for name in FLAGS)
    }
    return turn.ended | nonconforming


def is_twofold(turn: Turn) -> bool:
    """A name stands twice in the roster, so that rows don't tell who is who."""
    return len(set(turn.agents)) < len(turn.agents)


def is_up(flag: Any) -> bool:
    """True if a flag of an end is set; an array of flags isn't."""
    try:
        return bool(flag)
    except Exception:  # an array of flags says nothing
        return False


def plays_with_rosters(evidence: ProbeEvidence) -> Iterator[tuple[Episode, list[list[str]]]]:
    """Each episode of the rollouts, with the roster at the start of each of its turns."""
    for look in evidence.looks.get("rollout", ()):
        rosters = look.fact(TurnRosters)
        if look.episodes and rosters is not None:
            yield look.episodes[0], rosters.value.turns


def plays_to_their_end(evidence: ProbeEvidence) -> Iterator[tuple[Episode, Mapping[str, int]]]:
    """Each episode of the rollouts, and those of nearer limits, with what was built into these."""
    yield from ((episode, {}) for episode in evidence["rollout"])
    for look in evidence.looks.get("near_limit", ()):
        near = look.fact(NearLimit)
        if near is not None:
            yield look.episodes[0], near.value.options


def ticks_before(episode: Episode, api: str) -> Iterator[tuple[Turn, int]]:
    """Each turn with the ticks that were over at its start.

    Parallel: a tick is a step. AEC: a tick is over when nobody has more turns of its own in it, so
    as many are over, or under way, as the agent that has acted most has acted.
    """
    acted: Counter[str] = Counter()
    most = 0
    for turn in episode.turns:
        yield turn, turn.index if api == "parallel" else most
        ended = ended_in(turn)
        for agent in turn.order:
            if agent not in ended:
                acted[agent] += 1
                most = max(most, acted[agent])


def may_leave(contract: Contract, agent: str) -> bool:
    """Tells whether the contract lets agents of its role leave before they end."""
    name = contract.role_of(agent)
    return bool(name is not None and contract.roles[name].may_leave)
