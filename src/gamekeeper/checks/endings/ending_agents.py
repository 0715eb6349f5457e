"""Checks of agents that end: their flags, that they leave, and that all leave with the episode."""

from collections.abc import Iterator, Set
from dataclasses import replace
from typing import Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import (
    ended_in,
    is_twofold,
    may_leave,
    plays_to_their_end,
    plays_with_rosters,
    tells_both_flags,
)
from gamekeeper.checks.facts.space_facts import NumpyFlag
from gamekeeper.checks.facts.surface_facts import FlaggedAgents, LiveRosters
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import agents_leave_by_ending as agents_left
from gamekeeper.checks.reproducers import endings_take_all, flags_stay_up
from gamekeeper.checks.rosters.agent_entries import has_nonconforming_rows
from gamekeeper.checks.timing.agent_turns import departures
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import shown
from gamekeeper.episodes.episode import Episode, Turn

KINDS: Final = {"termination": "terminated", "truncation": "truncated"}


def _undeclared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    owners = {ending.owner for ending in contract.endings.values()} - {None, "agent"}
    return None if owners else "no ending is declared to be everybody's, or a role's"


@check(
    "GK500",
    HIGH,
    "rollout",
    applies=_undeclared,
    looks_at="an ending that is declared to be everybody's or a role's",
)
def endings_reach_all_whom_they_are_declared_for(
    contract: Contract, evidence: ProbeEvidence
) -> Cases:
    """An ending that is declared to be everybody's, or a role's, ends all of them at once.

    An agent that goes on playing after all others have ended earns rewards in a world
    that the rules don't describe.

    Bad: `cleared = { kind = "termination", owner = "all" }`, and only the carrier terminates.

    Good: `terminations = dict.fromkeys(self.agents, self.is_cleared)`.

    Fix: end every agent that the ending belongs to in the same step, or declare its owner as it is
    """
    for episode, rosters in plays_with_rosters(evidence):
        known: set[str] = set()
        for turn in episode.turns:
            new = turn.ended - known
            known |= turn.ended
            roster = rosters[turn.index - 1] if 0 < turn.index <= len(rosters) else []
            for agent in sorted(new & set(roster)):
                owed = _owners(contract, episode, turn, agent, roster)
                if owed is None:
                    continue
                left = sorted(owed - known)
                where = episode.at(turn, agent, "endings")
                expected = "all of them end with it"
                proof = reproducer_of(endings_take_all, api=evidence.api)
                yield Case(where, not left, expected, f"{', '.join(left)} went on", proof)


def _owners(
    contract: Contract, episode: Episode, turn: Turn, agent: str, roster: list[str]
) -> Set[str] | None:
    """Agents that the agent's ending has to end too; None where that isn't declared."""
    reason = episode.endings.get(agent)
    if reason is not None:
        declared = contract.endings.get(reason)
        owner = None if declared is None else declared.owner
    else:  # no reason is named: only where all endings of the kind are everybody's
        flags = {kind for kind, name in KINDS.items() if getattr(turn, name).get(agent)}
        owners = {each.owner for each in contract.endings.values() if each.kind in flags}
        owner = "all" if owners == {"all"} else None
    if owner in (None, "agent"):
        return None
    return {a for a in roster if owner == "all" or contract.role_of(a) == owner}


PROOFS: Final = {
    "parallel": Reproducer("""\
gone = [agent for agent in ACTIONS[-1] if agent not in env.agents]
silent = [a for a in gone if not terminations.get(a) and not truncations.get(a)]
assert not silent, silent"""),
    "aec": reproducer_of(agents_left),
}


@check("GK501", HIGH, "rollout", "surface", looks_at="an agent that leaves `agents`")
def agents_leave_by_ending(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent leaves `agents` only once it has terminated or truncated, and the flag says so.

    A learner that sees no end waits for an agent that never acts again, and bootstraps from
    nothing.

    Bad: `self.agents.remove(walker)`, while `terminations[walker]` is False.

    Good: `terminations[walker] = True` in the step that removes it.

    Fix: set the agent's termination or truncation in the step that takes it out of `agents`, or
    declare may_leave for its role
    """
    if not tells_both_flags(evidence):
        return
    left = _left_a_tick(evidence)
    if evidence.api == "aec":
        left = ((e.episode, e.turn + 1, agent, up) for e, agent, up in departures(evidence))
    for episode, turn, agent, has_ended in left:
        if not may_leave(contract, agent):
            where = episode.at(turn, agent, "agents")
            expected = "a termination or a truncation"
            seen = "it is gone without either"
            yield Case(where, has_ended, expected, seen, PROOFS[evidence.api])


def _left_a_tick(evidence: ProbeEvidence) -> Iterator[tuple[Episode, int, str, bool]]:
    """Yields each agent that left a Parallel episode, its turn, and if its flags had been up."""
    for episode in evidence["rollout"]:
        live: frozenset[str] = frozenset()
        ended: set[str] = set()
        for turn in episode.turns:
            new = ended_in(turn)
            ended |= new
            left = live - turn.live
            is_over = not turn.live and len(left) > 1 and bool(left & new)
            left = left & ended if is_over else left  # at the others GK502 looks
            left -= turn.terminated.keys() ^ turn.truncated.keys()  # of half an end GK108 tells
            if not is_twofold(turn):
                yield from ((episode, turn.index, agent, agent in ended) for agent in sorted(left))
            live = turn.live


ALL_OVER_PROOF = """\
silent = [a for a in ACTIONS[-1] if not terminations.get(a) and not truncations.get(a)]
assert env.agents or not silent, silent"""


@check(
    "GK502",
    HIGH,
    "rollout",
    "surface",
    api="parallel",
    looks_at="an agent that ends while others are live",
)
def the_episode_is_over_for_those_who_ended(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Ending one agent empties `agents` only where the others terminate or truncate too.

    The others' last step looks like any other: their returns are bootstrapped from a state that
    nobody ever plays on from.

    Bad: `if any(terminations.values()): self.agents = []`.

    Good: the same, after `terminations = dict.fromkeys(terminations, True)`.

    Fix: where one agent's end is the end for all, terminate (or truncate) all of them in that step;
    else keep the others in `agents`
    """
    if not tells_both_flags(evidence):
        return
    if not all(has_ended for *_, has_ended in _left_a_tick(evidence)):
        return  # they leave without a flag at other times too, of which GK501 tells
    for episode in evidence["rollout"]:
        live: frozenset[str] = frozenset()
        for turn in episode.turns:
            ended = ended_in(turn) & live
            if ended and not turn.live and not is_twofold(turn):
                silent = sorted(live - ended)
                where = episode.at(turn, silent[0] if silent else None, "agents")
                expected = "a termination or a truncation of everybody"
                seen = f"{', '.join(sorted(ended))} ended, and {', '.join(silent)} stopped without"
                yield Case(where, not silent, expected, f"{seen} either", ALL_OVER_PROOF)
            live = turn.live


ENDED_OUT_PROOF = """\
ended = [a for a in env.agents if terminations.get(a) or truncations.get(a)]
assert not ended, ended"""


@check(
    "GK503",
    HIGH,
    "rollout",
    "near_limit",
    api="parallel",
    looks_at="an agent that terminates or truncates",
)
def the_ended_are_out_of_agents(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that has terminated or truncated is out of `agents` when that step returns.

    `while env.agents` is how an episode is played: where `agents` isn't emptied at the end it goes
    on for ever, and where one stays in it the dead are asked for actions.

    Bad: `truncations = dict.fromkeys(self.agents, True)`, and `agents` stays as it was.

    Good: `self.agents = [a for a in self.agents if not (terminations[a] or truncations[a])]`.

    Fix: take agents that terminate or truncate out of `agents` before step returns; when the
    episode is over, `self.agents = []`
    """
    for episode, options in plays_to_their_end(evidence):
        for turn in episode.turns:
            ended = ended_in(turn)
            if not ended or not turn.index:
                continue
            still = sorted(ended & turn.live)
            where = episode.at(turn, still[0] if still else None, "agents")
            seen = f"{', '.join(still)} ended, and stays"
            proof = Reproducer(ENDED_OUT_PROOF, options=options)
            yield Case(where, not still, "only those who go on", seen, proof)


BOOKS: Final = {"terminated": "terminations", "truncated": "truncations"}


@check("GK504", MEDIUM, "rollout", "spaces")
def flags_are_bools(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Terminations and truncations are bools, not numbers, None or arrays.

    `flag is True`, `~flag` and masks of arrays mean something else for 1 than for True, and None or
    an array isn't an answer at all. NumPy's bool is of low severity: PettingZoo's own API test
    refuses it, and it can't be written as JSON.

    Bad: `terminations[agent] = self.steps // 100`.

    Good: `terminations[agent] = self.steps >= 100`.

    Fix: make a bool of it: `terminations[agent] = bool(...)`
    """
    for episode in evidence["rollout"]:
        is_nonconforming = has_nonconforming_rows(episode)
        for turn in episode.turns:
            bad = [
                (agent, name, nonconforming[name])
                for agent, nonconforming in (turn.nonconforming.items() if is_nonconforming else ())
                for name in BOOKS
                if nonconforming.get(name, {}).get("type", "missing") != "missing"
            ]
            for agent, name, flag in bad:
                where = episode.at(turn, agent, BOOKS[name])
                seen = f"{flag['type']}: {shown(flag.get('value'))}"
                yield Case(where, False, "a bool", seen, _proof(evidence.api, BOOKS[name]))
            if not bad and (turn.terminated or turn.truncated):
                yield Case(episode.at(turn, None, "terminations"), True)
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
    "GK505", HIGH, "rollout", api="aec", looks_at="an agent that has ended and is still in `agents`"
)
def an_ending_is_final(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The flags of an agent that has ended aren't taken back while it is still in `agents`.

    In the one step the learner closes the agent's trajectory, in the next it is told that nothing
    has happened.

    Bad: `self.terminations = {a: self.energy[a] <= 0 for a in self.agents}`, and energy comes back.

    Good: `if self.energy[a] <= 0: self.terminations[a] = True`.

    Fix: keep the flag up until the agent is out of `agents`; set flags where an agent ends, don't
    work them out anew in every step
    """
    for episode, rosters in plays_with_rosters(evidence):
        ended: set[str] = set()
        for turn in episode.turns:
            roster = set(rosters[turn.index]) if turn.index < len(rosters) else set()
            ended &= roster
            for agent in sorted(ended & turn.live):
                flags = turn.terminated.get(agent), turn.truncated.get(agent)
                if flags == (None, None):
                    continue  # nothing is said of it at this turn
                where = episode.at(turn, agent, "terminations")
                is_ok = agent in ended_in(turn)
                expected = "terminated or truncated, as before"
                yield Case(where, is_ok, expected, "neither", reproducer_of(flags_stay_up))
            ended |= turn.ended & roster


AFTER = """\
env.reset(seed=SEED)
flagged = [a for a in env.agents if env.terminations[a] or env.truncations[a]]
assert not flagged, flagged"""
FRESH = f"env = make()\n{AFTER}"


@check("GK506", HIGH, "surface", api="aec")
def a_reset_takes_the_flags_down(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """After a reset no agent is terminated or truncated, however the last episode ended.

    An episode whose agents have ended before it begins is over at once, and the loop around it
    counts an empty one.

    Bad: flags are set in the constructor and by `step` only.

    Good: `self.terminations = dict.fromkeys(self.agents, False)` in `reset`.

    Fix: in reset: `self.terminations = dict.fromkeys(self.agents, False)`, and the same for
    truncations
    """
    rosters = {fact.where.play: fact.value for fact in evidence.facts(LiveRosters)}
    for fact in evidence.facts(FlaggedAgents):
        first, second, third = fact.value.resets
        turns = len(rosters[fact.where.play].turns)
        if not turns:
            continue
        flagged = first or second
        where = replace(fact.where, turn=0)
        proof = FRESH if first else AFTER
        yield Case(where, not flagged, "no flags up", f"up: {', '.join(flagged)}", proof)
        if not flagged and rosters[fact.where.play].again is not None:
            where = replace(fact.where, turn=turns - 1, field="terminations after the next reset")
            yield Case(where, not third, "no flags up", f"up: {', '.join(third)}", AFTER)
