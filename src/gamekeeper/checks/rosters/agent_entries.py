"""Checks of what the dictionaries say of agents that live, end or have left."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import may_leave
from gamekeeper.checks.facts.surface_facts import BookEntries, ReturnedForms
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import gives_dictionaries
from gamekeeper.checks.timing.agent_turns import departures
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.episodes.where import Where

PARTS: Final = {
    "obs": "observations",
    "cumulative_reward": "rewards",
    "terminated": "terminations",
    "truncated": "truncations",
    "info": "infos",
}
"""Parts of a row, and the dictionary in which each stands."""
FLAGS: Final = frozenset({"terminated", "truncated"})
ENTRIES_AT_RESET: Final = frozenset({"obs", "info"})


@dataclass(frozen=True, slots=True)
class TurnEntries:
    """One turn of a Parallel environment beside the one before.

    Attributes:
        turn: what was given at its start.
        before: the roster at the start of the turn before; empty after the reset.
        acted: who acted in the turn before.
        missing: parts that say nothing of an agent, by agent; only agents of whom any says.
    """

    turn: Turn
    before: frozenset[str]
    acted: frozenset[str]
    missing: dict[str, frozenset[str]]

    @property
    def all_parts(self) -> frozenset[str]:
        """The parts that were returned by the call."""
        return frozenset(PARTS) if self.turn.index else ENTRIES_AT_RESET

    def has(self, agent: str) -> frozenset[str]:
        """The parts that say something of an agent in this turn.

        A reward stands in the row of the turn whose step paid it: of an agent that has left, such
        a row holds nothing else, and nothing of it was returned at this turn.
        """
        missing = self.missing.get(agent, frozenset())
        if self.turn.index and not missing and agent not in self.turn.cumulative_reward:
            return frozenset()
        return self.all_parts - missing

    @property
    def says_nothing(self) -> bool:
        """No dictionary speaks of anybody: what was returned has another form."""
        return bool(self.turn.live) and not any(self.has(agent) for agent in self.turn.live)


def turn_entries(episode: Episode) -> Iterator[TurnEntries]:
    """The turns of a Parallel episode with what their dictionaries leave out."""
    before: frozenset[str] = frozenset()
    acted: frozenset[str] = frozenset()
    is_nonconforming = has_nonconforming_rows(episode)
    for turn in episode.turns:
        missing = {
            agent: frozenset(
                part for part in PARTS if nonconforming.get(part, {}).get("type") == "missing"
            )
            for agent, nonconforming in (turn.nonconforming.items() if is_nonconforming else ())
        }
        if turn.raised:  # the next turn repeats what was given at this one
            continue
        yield TurnEntries(turn, before, acted, missing)
        before, acted = turn.live, frozenset(turn.order)


def has_nonconforming_rows(episode: Episode) -> bool:
    """Tells whether any value isn't as declared; asking turns for it takes long."""
    return episode.steps["nonconforming"].null_count < episode.steps.num_rows  # type: ignore[no-any-return]


def entry_place(episode: Episode, turn: Turn, agent: str, part: str) -> Where:
    """Place of a missing entry; a reward belongs to the turn whose step gave it."""
    number = turn.index - 1 if part == "cumulative_reward" else turn.index
    return episode.at(number, agent, PARTS[part])


ACCOUNTS: Final = frozenset({"cumulative_reward", "terminated", "truncated"})
NONE_GONE: Final = "assert not gone, gone"
GONE: Final = f"gone = set({{book}}) - set(env.agents) - set(ACTIONS[-1])\n{NONE_GONE}"
GONE_FROM: Final = f"gone = set({{book}}) - set(env.agents)\n{NONE_GONE}"
LIVING: Final = "missing = set(env.agents) - set({book})\nassert not missing, missing"
BOOKS: Final = ("rewards", "terminations", "truncations", "infos")


@check("GK106", MEDIUM, "rollout", "surface")
def accounts_are_kept_of_the_living_only(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that has left has no entry in rewards, terminations, truncations.

    Readers walk over the dictionaries: they store steps that the dead never made, count its end
    once a step, or add up what nobody was paid.

    Bad: `rewards = {a: 0.0 for a in self.possible_agents}` in every step.

    Good: `rewards = {a: 0.0 for a in self.agents}`, taken before anybody is removed.

    Fix: build the dictionaries over those who acted in this step (and who joined in it), not over
    possible_agents
    """
    if evidence.api == "aec":
        yield from _gone_in_books(evidence, _removed_early(contract, evidence))
        return
    for episode in evidence["rollout"]:
        ever: set[str] = set()
        turns = [*turn_entries(episode), None]
        for each, following in pairwise(turns):
            assert each is not None  # for the type checker: None stands behind the last one
            ever |= each.turn.live
            gone = {a for a in each.turn.agents if a in ever or a in evidence.agents}
            gone -= each.turn.live | each.before | each.acted
            if following is not None:  # they joined in the step, and may be paid in it
                gone -= following.turn.live
            gone -= each.turn.ended - ever  # they joined, and ended in the same step
            entries = [(a, part) for a in sorted(gone) for part in sorted(each.has(a) & ACCOUNTS)]
            yield from _too_many(episode, each.turn, entries, "it isn't in the game", GONE)


def _too_many(
    episode: Episode, turn: Turn, entries: list[tuple[str, str]], why: str, lines: str
) -> Cases:
    """Yields a case for each entry that shouldn't be there, else one for the turn."""
    for agent, part in entries:
        where, book = entry_place(episode, turn, agent, part), PARTS[part]
        proof = lines.format(book=book)
        yield Case(where, False, f"no entry: {why}", f"an entry in {book}", proof)
    if not entries:
        yield Case(episode.at(turn, None, "agents"), True)


def _removed_early(contract: Contract, evidence: ProbeEvidence) -> set[str]:
    """Agents that were removed without their None step; GK302 and GK501 tell of these."""
    return {
        agent
        for each, agent, _ in departures(evidence)
        if not (agent == each.actor and each.is_dead) and not may_leave(contract, agent)
    }


def _of_books(
    where: Where, found: Mapping[str, list[str]], expected: str, seen: str, lines: str
) -> Cases:
    """Yields a case for each book that has such agents, else one for the turn."""
    for name, agents in found.items():
        if agents:
            at, told = replace(where, agent=agents[0], field=name), f"{seen} {', '.join(agents)}"
            yield Case(at, False, expected, told, lines.format(book=f"env.{name}"))
    if not any(found.values()):
        yield Case(replace(where, field="agents"), True)


def _gone_in_books(evidence: ProbeEvidence, told: set[str]) -> Cases:
    for fact in evidence.facts(BookEntries):
        for turn, books in enumerate(fact.value.turns):
            found = {
                name: [each for each in books.strangers.get(name, ()) if each not in told]
                for name in BOOKS
            }
            where, expected = replace(fact.where, turn=turn), "entries of those in agents"
            yield from _of_books(where, found, expected, "also of", GONE_FROM)


@check("GK107", HIGH, "rollout", "surface")
def every_live_agent_is_told_everything(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every agent in `agents` is given an observation, a reward and both flags, at every step.

    An agent without an observation can't choose an action, and one without a reward or a flag
    makes learners raise KeyError or shift their batches by a step. So it is of an agent that
    joins in the step.

    Bad: `observations = {a: see(a) for a in moved}`: who waited is told nothing.

    Good: `observations = {a: see(a) for a in self.agents}`.

    Fix: give every agent in `agents` its entry in each dictionary, also where nothing happened to
    it: build them over `self.agents`
    """
    if evidence.api == "aec":
        yield from _living_in_books(evidence)
        return
    misshapen = _misshapen(evidence)
    for episode in evidence["rollout"]:
        for each in turn_entries(episode):
            if each.says_nothing or (each.turn.index > 0) in misshapen:
                continue  # no dictionary, so no entry: GK110
            bad = [(a, p) for a in sorted(each.missing) for p in _owed(each, a)]
            for agent, part in bad:
                where = entry_place(episode, each.turn, agent, part)
                proof = LIVING.format(book=PARTS[part])
                yield Case(where, False, "an entry, as the agent is live", "no entry", proof)
            if not bad and not misshapen:
                yield Case(episode.at(each.turn, None, "agents"), True)


def _misshapen(evidence: ProbeEvidence) -> set[bool]:
    """Tells by `is_step` which calls return another form than the API's; GK110 tells of them."""
    forms = [fact.value.calls for fact in evidence.facts(ReturnedForms)]
    return {turn > 0 for calls in forms for turn, wrong in enumerate(calls) if wrong}


def _owed(each: TurnEntries, agent: str) -> list[str]:
    """Parts that a live agent should have, also one that has just joined.

    Source: PettingZoo's parallel_api_test reads both flags of every agent in `agents`, and the
    `last()` of its parallel_to_aec all of them.
    """
    owed = each.all_parts - {"info"} if agent in each.turn.live else frozenset()
    return sorted(each.missing[agent] & owed)


def _living_in_books(evidence: ProbeEvidence) -> Cases:
    for fact in evidence.facts(BookEntries):
        for turn, books in enumerate(fact.value.turns):
            missing = {name: a for name, a in books.missing.items() if name != "infos"}
            where, expected = replace(fact.where, turn=turn), "an entry for every agent in agents"
            yield from _of_books(where, missing, expected, "none for", LIVING)


LAST_STEP: Final = """\
ended = [agent for agent in ACTIONS[-1] if agent not in env.agents]
missing = [agent for agent in ended if agent not in {book}]
assert not missing, missing"""


@check("GK108", HIGH, "rollout", "surface", api="parallel", looks_at="an agent that ends")
def the_last_step_is_told_whole(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that ends is given its last reward, last observation and both flags in that step.

    The reward for winning or dying is most often the last one. Without its entry the agent never
    learns of it, and without the last observation a truncated return can't be bootstrapped.

    Bad: `self.agents` loses the dead, then `rewards = {a: pay[a] for a in self.agents}`.

    Good: `rewards = {a: pay[a] for a in acting}`, with `acting` as it was before the step.

    Fix: build the dictionaries of a step over those who acted in it, before the ones that ended are
    taken out of `agents`
    """
    misshapen = _misshapen(evidence)
    for episode in evidence["rollout"]:
        for each in turn_entries(episode):
            if (each.turn.index > 0) in misshapen:
                continue
            for agent in sorted(each.acted - each.turn.live):
                if not each.has(agent) or agent not in each.turn.agents:
                    continue  # nothing is told of it at all: it left without ending
                lost = sorted(each.missing.get(agent, frozenset()) - {"info"})
                if set(lost) >= FLAGS:
                    continue  # nothing says that it has ended: GK501 or GK502
                for part in lost:
                    where = entry_place(episode, each.turn, agent, part)
                    expected = "an entry in the step that ends the agent"
                    proof = LAST_STEP.format(book=PARTS[part])
                    yield Case(where, False, expected, "no entry", proof)
                if not lost:
                    yield Case(episode.at(each.turn, agent, "agents"), True)


INFOS_AT_RESET = "assert not set(env.agents) - set(infos), set(env.agents) - set(infos)"
IN_STEP = """\
owed = [*env.agents, *(agent for agent in ACTIONS[-1] if agent in terminations)]
missing = [agent for agent in owed if agent not in infos]
assert not missing, missing"""
IN_BOOKS = "assert not set(env.agents) - set(env.infos), set(env.agents) - set(env.infos)"


@check("GK109", MEDIUM, "rollout", "surface")
def every_agent_is_given_an_info(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every agent has its entry in infos: after reset, in every step, and in its last one.

    Wrappers and trainers read `infos[agent]` for masks and statistics, and raise KeyError where an
    entry is missing; an empty dictionary does, and so does a defaultdict.

    Bad: `return observations, {}` from reset.

    Good: `return observations, {a: {} for a in self.agents}`.

    Fix: give every agent an info, an empty dictionary where there is nothing to say: `{a: {} for a
    in agents}`
    """
    if evidence.api == "aec":
        for fact in evidence.facts(BookEntries):
            for turn, books in enumerate(fact.value.turns):
                agents = books.missing.get("infos", ())
                where = replace(fact.where, turn=turn, field="infos")
                seen = f"none for {', '.join(agents)}"
                yield Case(where, not agents, "an entry for every agent in agents", seen, IN_BOOKS)
        return
    answers = any(fact.value.infos_answer for fact in evidence.facts(ReturnedForms))
    misshapen = _misshapen(evidence)
    for episode in evidence["rollout"]:
        for each in turn_entries(episode):
            if each.says_nothing or (each.turn.index > 0) in misshapen:
                continue
            owed = each.turn.live | {agent for agent in each.acted if each.has(agent)}
            owed &= set(each.turn.agents)
            lost = sorted(a for a in owed if "info" in each.missing.get(a, ()) and not answers)
            if lost or not misshapen:
                where = episode.at(each.turn, lost[0] if lost else None, "infos")
                seen = f"none for {', '.join(lost)}"
                proof = IN_STEP if each.turn.index else INFOS_AT_RESET
                yield Case(where, not lost, "an entry for every agent", seen, proof)


EXPECTED: Final = {
    True: "a pair of dictionaries: observations, infos",
    False: "five dictionaries: observations, rewards, terminations, truncations, infos",
}
LAST: Final = "a tuple of five: observation, reward, terminated, truncated, info"
PROOF_AEC: Final = "out = env.last()\nassert isinstance(out, tuple) and len(out) == 5, out"


@check("GK110", HIGH, "surface")
def reset_returns_two_dictionaries_and_step_five(
    contract: Contract, evidence: ProbeEvidence
) -> Cases:
    """A reset returns two dictionaries by agent, a step five, and last() five values; never fewer.

    The first two are for Parallel environments, `last()` is for AEC ones. Every loop unpacks them.
    Four values are the form of before PettingZoo 1.24, which had no truncations; one flag for all
    can't say who has ended.

    Bad: `return observations, rewards, dones, infos`.

    Good: `return observations, rewards, terminations, truncations, infos`.

    Fix: return (observations, infos) from reset and (observations, rewards, terminations,
    truncations, infos) from step, each a dictionary by agent, also once the episode is over; leave
    last() as AECEnv has it
    """
    for fact in evidence.facts(ReturnedForms):
        for turn, wrong in enumerate(fact.value.calls):
            if evidence.api == "aec":
                where = replace(fact.where, turn=turn, field="what last returns")
                yield Case(where, not wrong, LAST, wrong, proof=PROOF_AEC)
                continue
            field = "what step returns" if turn else "what reset returns"
            is_ok = not wrong
            expected = EXPECTED[not turn]
            proof = reproducer_of(gives_dictionaries)
            yield Case(replace(fact.where, turn=turn, field=field), is_ok, expected, wrong, proof)


GONE_VIEWS: Final = f"""\
gone = set({{book}}) & set(env.possible_agents)
gone -= set(env.agents) | set(ACTIONS[-1])
{NONE_GONE}"""


@check(
    "GK113", LOW, "rollout", api="parallel", looks_at="an agent that left while others were live"
)
def the_gone_are_shown_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that has left has no entry in observations or infos.

    A training loop that takes the keys of the observations for the agents that act next hands over
    actions of agents that have ended, and stores steps that they never made.

    Bad: `observations = {a: see(a) for a in self.possible_agents}` in every step.

    Good: `observations = {a: see(a) for a in acting}`.

    Fix: build observations and infos over those who acted in this step (and who joined in it), not
    over possible_agents
    """
    for episode in evidence["rollout"]:
        ever: set[str] = set()
        for each in turn_entries(episode):
            ever |= each.turn.live
            gone = (set(each.turn.agents) & ever) - each.turn.live - each.before - each.acted
            parts = {a: sorted(each.has(a) & ENTRIES_AT_RESET) for a in sorted(gone)}
            entries = [(a, part) for a in parts for part in parts[a]]
            yield from _too_many(episode, each.turn, entries, "it has left", GONE_VIEWS)
