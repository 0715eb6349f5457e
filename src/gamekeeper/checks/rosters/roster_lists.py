"""Checks of the lists `possible_agents` and `agents`: known, kept, filled anew, counted right."""

from dataclasses import replace
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import plays_with_rosters
from gamekeeper.checks.facts.episode_facts import AgentNames, TurnRosters
from gamekeeper.checks.facts.surface_facts import (
    AgentCounts,
    LiveRosters,
    PossibleAgents,
    RosterKinds,
)
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import names_stay, names_stay_after_reset
from gamekeeper.checks.rosters.agent_entries import PARTS, entry_place, turn_entries
from gamekeeper.contract import Contract
from gamekeeper.episodes.where import Where

PROOF = Reproducer(
    "env = make()\nassert list(env.possible_agents), env.possible_agents", plays=False
)


@check("GK101", MEDIUM, "surface")
def possible_agents_are_known_before_a_reset(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """possible_agents names every possible agent before the first reset; it isn't empty.

    Wrappers, vector environments and trainers ask it for spaces and build one policy for each name
    before anything is reset. An environment that can't know its agents leaves the attribute out.

    Bad: `self.possible_agents = []` in the constructor, filled by `reset`.

    Good: `self.possible_agents = [f"rover_{i}" for i in range(count)]` in the constructor.

    Fix: fill possible_agents in the constructor with every agent that may ever appear; leave the
    attribute out where nobody can know them
    """
    for fact in evidence.facts(PossibleAgents):
        before = fact.value.before
        if before is None and all(names is None for names in fact.value.turns):
            continue
        expected = "the names of all possible agents, before any reset"
        seen = "no such attribute until the reset" if before is None else before
        yield Case(replace(fact.where, turn=0), bool(before), expected, seen, PROOF)


OF_ANOTHER = Reproducer(
    """\
one, other = list(make().possible_agents), list(make().possible_agents)
assert one == other, (one, other)""",
    plays=False,
)


@check("GK102", HIGH, "surface")
def possible_agents_never_change(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """possible_agents stays the same list of names for good, whoever leaves `agents`.

    Where `agents` is the same list as `possible_agents`, or shares it between instances, an agent
    that is removed is gone from every later episode, and readers who built a policy for each
    possible agent play another game than the first.

    Bad: `self.agents = self.possible_agents`, then `self.agents.remove(agent)`.

    Good: `self.agents = self.possible_agents[:]`.

    Fix: build possible_agents once in the constructor and never touch it again; in reset take a
    copy: `self.agents = self.possible_agents[:]`
    """
    first = list(evidence.agents)  # named before anything was played
    for fact in evidence.facts(PossibleAgents):
        before, turns = fact.value.before, fact.value.turns
        named = before or next((names for names in turns if names), None)
        if named is None:
            continue
        if first and before:
            is_fresh = fact.value.fresh
            whose = "of another instance" if is_fresh else "since the audit began"
            where = replace(fact.where, turn=0, field=f"possible_agents {whose}")
            yield _look(
                where,
                list(dict.fromkeys(before)),
                first,
                OF_ANOTHER if is_fresh else reproducer_of(names_stay),
            )
        yield from _in_play(fact, named, turns)


def _in_play(fact: Fact[PossibleAgents], named: list[str], turns: list[Any]) -> Cases:
    for turn, names in enumerate(turns):
        yield _look(replace(fact.where, turn=turn), names, named, reproducer_of(names_stay))
        if names != named:
            return
    if turns and fact.value.again is not None:
        where = replace(fact.where, turn=len(turns) - 1, field="possible_agents after a reset")
        yield _look(where, fact.value.again, named, reproducer_of(names_stay_after_reset))


def _look(where: Where, names: Any, named: list[str], proof: Reproducer) -> Case:
    return Case(where, names == named, named, names, proof=proof)


@check("GK104", HIGH, "rollout", "surface", "evidence")
def every_agent_is_named_once(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """No name stands twice in `agents` or in `possible_agents`.

    Two agents of one name are one in every dictionary: an action, a reward, a policy is lost, and
    who is removed once is still there.

    Bad: `self.agents += self.possible_agents` in a reset that doesn't empty the list first.

    Good: `self.agents = self.possible_agents[:]`.

    Fix: keep each name once; take agents out of the list that is there, or build it anew in reset,
    before names are added
    """
    for fact in evidence.facts(AgentNames):
        texts = [text for text, _ in {(text, kind) for text, kind in fact.value.names}]
        if len(set(texts)) < len(texts) or fact.value.no_values:
            return  # two agents, such as 1 and "1", whose texts are or may be alike: GK902
    for roster in evidence.facts(TurnRosters):
        for turn, names in enumerate(roster.value.turns):
            is_ok = len(set(names)) == len(names)
            proof = _distinct_proof("agents")
            yield Case(replace(roster.where, turn=turn), is_ok, "each name once", names, proof)
    for possible in evidence.facts(PossibleAgents):
        for turn, named in enumerate(possible.value.turns):
            if named is not None:
                is_ok = len(set(named)) == len(named)
                proof = _distinct_proof("possible_agents")
                where = replace(possible.where, turn=turn)
                yield Case(where, is_ok, "each name once", named, proof)


def _distinct_proof(roster: str) -> str:
    return f"names = list(map(str, env.{roster}))\nassert len(names) == len(set(names)), names"


FREE: Final = frozenset({"obs", "info"})
"""PettingZoo's own test allows keys for all of them, such as `common`, beside the agents'."""
ROSTER: Final = """\
strangers = set(env.agents) - set(env.possible_agents)
assert not strangers, strangers"""


@check("GK105", HIGH, "rollout", "surface")
def only_possible_agents_take_part(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Agents in `agents`, or with a reward or an ending, are among possible_agents.

    A trainer has no policy, no space and no column for a name that it never heard of: it crashes
    in the middle of an episode, or drops the agent. `__all__` is another library's habit.

    Bad: `self.agents.append(f"guest_{self.count}")`, while possible_agents lists three hosts.

    Good: `possible_agents` lists as many guests as can ever come, and `agents` those who are there.

    Fix: list in possible_agents every agent that may ever join, and speak of agents only in the
    dictionaries; where names can't be known leave possible_agents out
    """
    possible = set(evidence.agents)
    for fact in evidence.facts(PossibleAgents):
        stages = [fact.value.before, *fact.value.turns, fact.value.again]
        possible.update(name for names in stages for name in names or ())
    if not possible:
        return
    for roster in evidence.facts(LiveRosters):
        for turn, names in enumerate(roster.value.turns):
            strangers = sorted(set(names or ()) - possible)
            is_ok = not strangers
            seen = f"also {', '.join(strangers)}"
            yield Case(replace(roster.where, turn=turn), is_ok, sorted(possible), seen, ROSTER)
    if evidence.api == "parallel":
        yield from _strangers_in_dictionaries(evidence, possible)


def _strangers_in_dictionaries(evidence: ProbeEvidence, possible: set[str]) -> Cases:
    for episode in evidence["rollout"]:
        for each in turn_entries(episode):
            if not each.turn.index:
                continue
            strangers = [a for a in each.turn.agents if not _is_known(a, possible)]
            for agent in strangers:
                for part in sorted(each.has(agent) - FREE):
                    where = entry_place(episode, each.turn, agent, part)
                    seen = f"an entry of {agent!r}"
                    yield Case(where, False, "entries of agents only", seen, _stranger_proof(part))
            if not strangers:
                yield Case(episode.at(each.turn, None, "agents"), True)


def _is_known(agent: str, possible: set[str]) -> bool:
    """Possible, or no text: spelt in another way where agents were asked for, or told apart."""
    return agent in possible or agent.startswith(("{", "[")) or agent.rstrip("'") in possible


def _stranger_proof(part: str) -> str:
    book = PARTS[part]
    return f"strangers = set({book}) - set(env.possible_agents)\nassert not strangers, strangers"


FILLED = "env.reset(seed=SEED)\nassert list(env.agents), 'nobody is there after the reset'"
RESTORED = """\
env.reset(seed=SEED)
(fresh := make()).reset(seed=SEED)
assert set(env.agents) == set(fresh.agents), (list(env.agents), list(fresh.agents))"""


@check("GK103", HIGH, "surface")
def every_reset_fills_the_roster(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every reset fills `agents`: not empty, and no agent of the last episode is missing.

    A reset that leaves out agents which ended, or keeps what the last episode left, makes each
    episode smaller or larger than the one before; loops over `agents` do nothing at all where it
    stays empty.

    Bad: `reset` sets up the board, but `self.agents` was filled by the constructor only.

    Good: `self.agents = self.possible_agents[:]` in `reset`.

    Fix: fill `agents` anew in every reset, from scratch: `self.agents = self.possible_agents[:]`
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
        # where two resets in a row already differ the episode isn't to blame, and where the
        # possible agents have changed that is it
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


@check("GK111", LOW, "surface")
def num_agents_counts_the_roster(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """num_agents is the length of `agents`, and max_num_agents that of possible_agents.

    Loops and buffers are sized by them; a number that was fixed at construction is wrong from the
    first death on.

    Bad: `num_agents = 3`, while two are left.

    Good: no attributes of one's own, but those of `ParallelEnv` and `AECEnv`.

    Fix: leave num_agents and max_num_agents to PettingZoo's base class, which counts the lists
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


@check("GK112", HIGH, "rollout", looks_at="an agent that ended and left while others were live")
def nobody_comes_back_within_an_episode(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that has ended and left isn't revived under the same name in the same episode.

    Learners close its trajectory when it ends: what it does afterwards is glued to the dead one or
    lost, and returns are counted twice.

    Bad: `self.agents.append(prey)` some steps after the prey was eaten.

    Good: a prey that is eaten is set down elsewhere without ending, or `prey_7` joins for `prey_3`.

    Fix: keep an agent that will be back in `agents` without ending it, or let a new one join under
    a name that wasn't used in this episode
    """
    for episode, rosters in plays_with_rosters(evidence):
        ended_at = {turn.index: turn.ended for turn in episode.turns}
        ended: set[str] = set()
        gone: set[str] = set()
        live: set[str] = set()
        for turn, names in enumerate(rosters):
            ended |= ended_at.get(turn, set())  # without an end it may not leave, as GK501 says
            gone |= (live - set(names)) & ended
            live = set(names)
            back = sorted(live & gone)
            if gone:
                where = episode.at(turn, back[0] if back else None, "agents")
                expected = "gone for the rest of the episode"
                seen = f"back: {', '.join(back)}"
                yield Case(where, not back, expected, seen, _proof(evidence.api))
            gone -= live


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


@check("GK114", MEDIUM, "surface")
def rosters_are_lists(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`agents` and possible_agents are lists: ordered, with a length, empty once all have left.

    Readers slice, index and copy them and ask `while env.agents`. A set has another order in every
    process, a view of a dictionary changes while it is walked over, an array has no truth.

    Bad: `self.agents = {"a", "b"}` or `self.agents = self.robots.keys()`.

    Good: `self.agents = list(self.robots)`.

    Fix: keep the names in a list: `self.agents = list(...)`
    """
    for fact in evidence.facts(RosterKinds):
        for turn, kinds in fact.value.kinds:
            for roster, kind in zip(ROSTERS, kinds, strict=False):
                where = replace(fact.where, turn=turn, field=roster)
                proof = f"assert isinstance(env.{roster}, (list, tuple)), type(env.{roster})"
                yield Case(where, kind in FINE, "a list", f"a {kind}", proof)
