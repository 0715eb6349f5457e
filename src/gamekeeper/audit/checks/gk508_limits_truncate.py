"""GK508."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._ticks import ticks_before
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Trace, Turn

PLAYS = 2
"""By chance a rule ends an episode in its last tick once, not again and again."""
PROOF = {
    "parallel": "ended = [a for a in terminations if terminations[a] and not truncations[a]]\n"
    "assert not ended, 'terminated by a time limit: ' + ', '.join(map(str, ended))",
    "aec": "flags = env.terminations\n"
    "ended = [a for a in flags if flags[a] and not env.truncations[a]]\n"
    "assert not ended, 'terminated by a time limit: ' + ', '.join(map(str, ended))",
}


def _declared(contract: Contract, evidence: Gathered) -> str | None:
    is_declared = contract.schedule.horizon is not None
    return "the horizon is declared, so GK507 judges it" if is_declared else None


@check(
    "GK508",
    needs=("surface", "rollout"),
    severity=LOW,
    confidence=0.6,
    mend="truncate where time is up: `truncations = dict.fromkeys(agents, time >= max_time)`; if "
    "the last tick is a rule of the game, declare it in the contract's endings as a termination",
    applies=_declared,
)
def time_limits_truncate(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A time limit truncates an episode, it doesn't terminate it.

    Learners bootstrap past a truncation, and not past a termination: told the one for the other
    they value the states before the limit at nothing.

    A heuristic, as nobody has declared a limit: an attribute, a constant of the module or a
    parameter that is called like one (`max_steps`, `horizon`, `LIMIT`) holds the very number of
    ticks after which episodes end by termination, in two plays or more and in half of those that
    came to an end; none lasts longer, and nothing was ever truncated. A rule that ends games then
    by chance, as a battery that is empty in the last tick, would have to do so again and again.

    Bad: `terminations = dict.fromkeys(agents, time >= self.max_time)`.

    Good: `truncations = dict.fromkeys(agents, time >= self.max_time)`.
    """
    if any(ending.kind == "termination" for ending in contract.endings.values()):
        return
    looks = (*evidence.looks.get("surface", ()), *evidence.looks.get("rollout", ()))
    traces = [trace for look in looks for trace in look.traces]
    limits = {
        name: value
        for name, value in _limits(evidence).items()
        if not any(_lasts_longer(evidence.api, trace, value) for trace in traces)
    }
    found = [each for trace in traces for each in _at_the_limit(evidence.api, trace, limits)]
    is_truncated = any(_is_truncated(turn) for trace in traces for turn in trace.turns)
    whole = sum(trace.header.get("end") == "ended" for trace in traces)
    least = max(min(PLAYS, len(traces)), whole / 2)
    is_sure = sum(not each.ok for each in found) >= least and not is_truncated
    yield from (each for each in found if each.ok or is_sure)


def _limits(evidence: Gathered) -> dict[str, int]:
    """Names of limits that hold one number in all plays."""
    found = [fact.value for fact in evidence.facts("surface", "limits")]
    return {
        name: value
        for name, value in (found[0] if found else {}).items()
        if all(each.get(name) == value for each in found)
    }


def _lasts_longer(api: str, trace: Trace, limit: int) -> bool:
    """Whether somebody acts once that many ticks are over."""
    over = limit if api == "parallel" else limit + 1  # where the last tick is still under way
    return any(
        tick >= over and not set(turn.order) <= turn.ended
        for turn, tick in ticks_before(trace, api)
    )


def _at_the_limit(api: str, trace: Trace, limits: Mapping[str, int]) -> Iterator[Occasion]:
    """The turn, if there is one, at which a limit is met and somebody ends."""
    for turn, tick in ticks_before(trace, api):
        names = [name for name, value in limits.items() if value == tick]
        if names and turn.ended and _is_last(trace, turn):
            yield Occasion(
                trace.at(turn, None, "terminations"), any(turn.truncated.values()),
                f"truncated after {tick} ticks, as {names[0]} = {tick}",
                f"terminated: {', '.join(sorted(turn.ended))}", proof=PROOF[api],
            )  # fmt: skip
            return


def _is_truncated(turn: Turn) -> bool:
    """Somebody is; or a flag that is no bool may say so."""
    return any(turn.truncated.values()) or any("truncated" in odd for odd in turn.odd.values())


def _is_last(trace: Trace, turn: Turn) -> bool:
    """Nobody who hasn't ended acts from here on."""
    rest = (each for each in trace.turns if each.index >= turn.index)
    ended = set(turn.ended)
    for each in rest:
        ended |= each.ended
        if not set(each.order) <= ended:
            return False
    return True
