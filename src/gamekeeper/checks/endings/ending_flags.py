"""Checks of terminations and truncations."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import ended_in, plays_with_rosters
from gamekeeper.checks.facts.space_facts import NumpyFlag
from gamekeeper.checks.facts.surface_facts import FlaggedAgents, LiveRosters
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import flags_stay_up
from gamekeeper.checks.rosters.agent_entries import has_nonconforming_rows
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import shown

BOOKS: Final = {"terminated": "terminations", "truncated": "truncations"}


@check(
    "GK504",
    needs=("rollout", "spaces"),
    severity=MEDIUM,
    fix="make a bool of it: `terminations[agent] = bool(...)`",
)
def flags_are_bools(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Terminations and truncations are bools, not numbers, None or arrays.

    `flag is True`, `~flag` and masks of arrays mean something else for 1 than for True, and None or
    an array isn't an answer at all. NumPy's bool is of low severity: PettingZoo's own API test
    refuses it, and it can't be written as JSON.

    Bad: `terminations[agent] = self.steps // 100`.

    Good: `terminations[agent] = self.steps >= 100`.
    """
    for trace in evidence["rollout"]:
        is_nonconforming = has_nonconforming_rows(trace)
        for turn in trace.turns:
            bad = [
                (agent, name, nonconforming[name])
                for agent, nonconforming in (turn.nonconforming.items() if is_nonconforming else ())
                for name in BOOKS
                if nonconforming.get(name, {}).get("type", "missing") != "missing"
            ]
            for agent, name, flag in bad:
                where = trace.at(turn, agent, BOOKS[name])
                seen = f"{flag['type']}: {shown(flag.get('value'))}"
                yield Case(where, False, "a bool", seen, _proof(evidence.api, BOOKS[name]))
            if not bad and (turn.terminated or turn.truncated):
                yield Case(trace.at(turn, None, "terminations"), True)
    for fact in evidence.facts(NumpyFlag):
        proof = _proof(evidence.api, fact.where.field, "bool")
        yield Case(fact.where, False, "Python's bool", "NumPy's bool", proof=proof, severity=LOW)


def _proof(api: str, book: str, kinds: str = "(bool, np.bool_)") -> str:
    flags = book if api == "parallel" else f"env.{book}"
    return (
        f"flags = {flags}\n"
        f"odd = {{a: flags[a] for a in flags if not isinstance(flags[a], {kinds})}}\n"
        "assert not odd, odd"
    )


@check(
    "GK505",
    needs=("rollout",),
    severity=HIGH,
    fix="keep the flag up until the agent is out of `agents`; set flags where an agent ends, "
    "don't work them out anew in every step",
    api="aec",
    looks_at="an agent that has ended and is still in `agents`",
)
def an_ending_is_final(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The flags of an agent that has ended aren't taken back while it is still in `agents`.

    In the one step the learner closes the agent's trajectory, in the next it is told that nothing
    has happened.

    Bad: `self.terminations = {a: self.energy[a] <= 0 for a in self.agents}`, and energy comes back.

    Good: `if self.energy[a] <= 0: self.terminations[a] = True`.
    """
    for trace, rosters in plays_with_rosters(evidence):
        ended: set[str] = set()
        for turn in trace.turns:
            roster = set(rosters[turn.index]) if turn.index < len(rosters) else set()
            ended &= roster
            for agent in sorted(ended & turn.live):
                flags = turn.terminated.get(agent), turn.truncated.get(agent)
                if flags == (None, None):
                    continue  # nothing is said of it at this turn
                where = trace.at(turn, agent, "terminations")
                is_ok = agent in ended_in(turn)
                expected = "terminated or truncated, as before"
                yield Case(where, is_ok, expected, "neither", reproducer_of(flags_stay_up))
            ended |= turn.ended & roster


FRESH = """\
flagged = [a for a in env.agents if env.terminations[a] or env.truncations[a]]
assert not flagged, flagged"""
AFTER = f"env.reset(seed=SEED)\n{FRESH}"


@check(
    "GK506",
    needs=("surface",),
    severity=HIGH,
    fix="in reset: `self.terminations = dict.fromkeys(self.agents, False)`, and the same for "
    "truncations",
    api="aec",
)
def a_reset_takes_the_flags_down(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """After a reset nobody is terminated or truncated, whatever the last episode came to.

    An episode whose agents have ended before it begins is over at once, and the loop around it
    counts an empty one.

    Bad: flags are set in the constructor and by `step` only.

    Good: `self.terminations = dict.fromkeys(self.agents, False)` in `reset`.
    """
    rosters = {fact.where.play: fact.value for fact in evidence.facts(LiveRosters)}
    for fact in evidence.facts(FlaggedAgents):
        first, second, third = fact.value.resets
        turns = len(rosters[fact.where.play].turns)
        if not turns:
            continue
        flagged = first or second
        where = replace(fact.where, turn=0)
        yield Case(where, not flagged, "no flags up", f"up: {', '.join(flagged)}", FRESH)
        if not flagged and rosters[fact.where.play].again is not None:
            where = replace(fact.where, turn=turns - 1, field="terminations after the next reset")
            yield Case(where, not third, "no flags up", f"up: {', '.join(third)}", AFTER)
