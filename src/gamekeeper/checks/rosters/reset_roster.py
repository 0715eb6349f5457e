"""Checks of `agents`: filled by a reset, counted right, real lists, and no agent comes back."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import plays_with_rosters
from gamekeeper.checks.facts.surface_facts import (
    AgentCounts,
    LiveRosters,
    PossibleAgents,
    RosterKinds,
)
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode

FILLED = "assert list(env.agents), 'nobody is there after the reset'"
RESTORED = """\
env.reset(seed=SEED)
(fresh := make()).reset(seed=SEED)
assert set(env.agents) == set(fresh.agents), (list(env.agents), list(fresh.agents))"""


@check(
    "GK103",
    needs=("surface",),
    severity=HIGH,
    fix="fill `agents` anew in every reset, from scratch: `self.agents = self.possible_agents[:]`",
)
def every_reset_fills_the_roster(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every reset fills `agents`: somebody is there, and nobody of the last episode is missing.

    A reset that leaves out agents which ended, or keeps what the last episode left, makes each
    episode smaller or larger than the one before; loops over `agents` do nothing at all where it
    stays empty.

    Bad: `reset` sets up the board, but `self.agents` was filled by the constructor only.

    Good: `self.agents = self.possible_agents[:]` in `reset`.
    """
    shrunk = {
        fact.where.play
        for fact in evidence.facts(PossibleAgents)
        if fact.value.again != fact.value.before
    }
    for fact in evidence.facts(LiveRosters):
        first, turns, again = fact.value.first, fact.value.turns, fact.value.again
        if not turns or turns[0] is None:
            continue
        where = replace(fact.where, turn=0)
        yield Case(where, bool(turns[0]), "agents that can act", "nobody", FILLED)
        # where two resets in a row already differ the play isn't to blame, and where the possible
        # agents have changed that is it
        is_known = first is not None and sorted(first) == sorted(turns[0])
        if turns[0] and is_known and fact.where.play not in shrunk:
            where = replace(fact.where, turn=len(turns) - 1, field="agents after the next reset")
            is_ok = again is None or set(again) == set(first or ())
            yield Case(where, is_ok, first, again, RESTORED)
            if fact.value.midway is not None:
                turn, midway = fact.value.midway
                where = replace(fact.where, turn=turn, field="agents after a reset in mid-episode")
                is_ok = midway is None or set(midway) == set(first or ())
                yield Case(where, is_ok, first, midway, RESTORED)


@check(
    "GK111",
    needs=("surface",),
    severity=LOW,
    fix="leave num_agents and max_num_agents to PettingZoo's base class, which counts the lists",
)
def num_agents_counts_the_roster(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """num_agents is the length of `agents`, and max_num_agents that of possible_agents.

    Loops and buffers are sized by them; a number that was fixed at construction is wrong from the
    first death on.

    Bad: `num_agents = 3`, while two are left.

    Good: no attributes of one's own, but those of `ParallelEnv` and `AECEnv`.
    """
    for fact in evidence.facts(AgentCounts):
        for turn, (live, most, agents, possible) in enumerate(fact.value.turns):
            for name, roster, said, size in (
                ("num_agents", "agents", live, agents),
                ("max_num_agents", "possible_agents", most, possible),
            ):
                if said is not None and size is not None:
                    yield Case(
                        replace(fact.where, turn=turn, field=name),
                        said == size,
                        size,
                        said,
                        proof=f"count = len(env.{roster})\n"
                        f"assert env.{name} == count, (env.{name}, count)",
                    )


@check(
    "GK112",
    needs=("rollout",),
    severity=HIGH,
    fix="keep an agent that will be back in `agents` without ending it, or let a new one join "
    "under a name that wasn't used in this episode",
    looks_at="an agent that has left while others play on",
)
def nobody_comes_back_within_an_episode(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that has ended and left isn't revived under the same name in the same episode.

    Learners close its trajectory when it ends: what it does afterwards is glued to the dead one or
    lost, and returns are counted twice.

    Bad: `self.agents.append(prey)` some steps after the prey was eaten.

    Good: a prey that is eaten is set down elsewhere without ending, or `prey_7` joins for `prey_3`.
    """
    for trace, rosters in plays_with_rosters(evidence):
        gone: set[str] = set()
        live: set[str] = set(rosters[0]) if rosters else set()
        for turn, names in enumerate(rosters):
            gone |= live - set(names)
            live = set(names)
            back = sorted(live & gone)
            back = [agent for agent in back if not _may_return(contract, trace, agent, turn)]
            if gone:
                where = trace.at(turn, back[0] if back else None, "agents")
                expected = "gone for the rest of the episode"
                seen = f"back: {', '.join(back)}"
                yield Case(where, not back, expected, seen, _proof(evidence.api))
            gone -= live


def _may_return(contract: Contract, trace: Episode, agent: str, turn: int) -> bool:
    """Declared free to leave and join, and didn't end before."""
    role = contract.roles.get(contract.role_of(agent) or "")
    if role is None or not (role.may_leave and role.may_join):
        return False
    return not any(agent in each.ended for each in trace.turns if each.index < turn)


def _proof(api: str) -> str:
    env_step = "env.step(each)" if api == "parallel" else "env.last(), env.step(each)"
    return (
        "env.reset(seed=SEED)\nlive, gone = set(env.agents), set()\n"
        f"for each in ACTIONS:\n    {env_step}\n"
        "    gone |= live - set(env.agents)\n    live = set(env.agents)\n"
        "    assert not live & gone, live & gone"
    )


FINE: Final = ("list", "tuple", "")
ROSTERS: Final = ("agents", "possible_agents")


@check(
    "GK114",
    needs=("surface",),
    severity=MEDIUM,
    fix="keep the names in a list: `self.agents = list(...)`",
)
def rosters_are_lists(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`agents` and possible_agents are lists: ordered, with a length, empty once nobody is left.

    Readers slice, index and copy them and ask `while env.agents`. A set has another order in every
    process, a view of a dictionary changes while it is walked over, an array has no truth.

    Bad: `self.agents = {"a", "b"}` or `self.agents = self.robots.keys()`.

    Good: `self.agents = list(self.robots)`.
    """
    for fact in evidence.facts(RosterKinds):
        for turn, kinds in fact.value.kinds:
            for roster, kind in zip(ROSTERS, kinds, strict=False):
                where = replace(fact.where, turn=turn, field=roster)
                proof = f"assert isinstance(env.{roster}, (list, tuple)), type(env.{roster})"
                yield Case(where, kind in FINE, "a list", f"a {kind}", proof)
