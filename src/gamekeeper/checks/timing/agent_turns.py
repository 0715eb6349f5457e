"""Checks of the agent in turn: it is live, and an agent that ended gets its last turn."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import ended_in, may_leave
from gamekeeper.checks.facts.episode_facts import NearLimit, SelectedAgents, TurnRosters
from gamekeeper.checks.facts.lifecycle_facts import IteratedAgents
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import dead_agents_wait, dead_turns_are_taken
from gamekeeper.checks.reproducers import dead_steps_remove as dead_agent_is_removed
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode


@dataclass(frozen=True, slots=True)
class AecStep:
    """One step of an AEC play.

    Attributes:
        turn: the one that it ends.
        is_dead: the actor had ended before it.
        before: `agents` before the step.
        after: `agents` after it.
        ended: agents whose flags were up before it, and that haven't left.
        options: a nearer limit, that the environment was built with.
    """

    episode: Episode
    turn: int
    actor: str
    is_dead: bool
    before: Sequence[str]
    after: Sequence[str]
    ended: frozenset[str]
    options: Mapping[str, int] = field(default_factory=dict)


def aec_steps(evidence: ProbeEvidence) -> Iterator[list[AecStep]]:
    """The steps of each episode that have been made."""
    rosters = [fact.value.turns for fact in evidence.facts(TurnRosters)]
    for episode, agents in zip(evidence["rollout"], rosters, strict=False):
        yield list(_env_steps(episode, agents))


def _steps_to_near_limits(evidence: ProbeEvidence) -> Iterator[list[AecStep]]:
    """The steps of each episode of an instance that was built with a nearer limit."""
    for look in evidence.looks.get("near_limit", ()):
        near = look.fact(NearLimit)
        if near is not None:
            steps = _env_steps(look.episodes[0], near.value.rosters)
            yield [replace(each, options=near.value.options) for each in steps]


def _env_steps(episode: Episode, agents: Sequence[Sequence[str]]) -> Iterator[AecStep]:
    ended: frozenset[str] = frozenset()
    for turn in episode.turns:
        if turn.index + 1 >= len(agents) or not turn.order:
            return
        before, after = agents[turn.index], agents[turn.index + 1]
        actor = turn.order[0]
        # an agent that is back under its name begins anew
        flagged = ended_in(turn)
        ended = (ended | flagged) & frozenset(before)
        yield AecStep(episode, turn.index, actor, actor in flagged, before, after, ended)


def departures(evidence: ProbeEvidence) -> Iterator[tuple[AecStep, str, bool]]:
    """Yields each agent that left in an AEC step, and if its flags were up before or after it."""
    for play in aec_steps(evidence):
        leaving = {each.turn + 1: each for each in play if set(each.before) - set(each.after)}
        for turn in play[0].episode.turns if leaving else ():
            if turn.index in leaving:
                each = leaving[turn.index]
                for agent in sorted(set(each.before) - set(each.after)):
                    yield each, agent, agent in each.ended | ended_in(turn)


SELECTED: Final = (
    "assert not env.agents or env.agent_selection in env.agents, (env.agent_selection, env.agents)"
)


@check("GK301", HIGH, "rollout", api="aec", looks_at="a turn with agents left in `agents`")
def selection_is_live(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`agent_selection` names an agent of `agents` as long as there are any, never one removed.

    `last()` and `step()` speak of the agent that is selected: where it isn't in the game any more,
    the loop that everybody writes ends in a KeyError, or one agent's turn is taken for another's.

    Bad:
        if self.terminations[agent]:
            self.agents.remove(agent)             # and it stays selected
            return

    Good:
        if self.terminations[agent]:
            self._was_dead_step(action)           # selects who comes next
            return

    Fix: after every step name an agent of `agents` in `agent_selection`, also after the None step
    of a dead agent
    """
    for fact in evidence.facts(SelectedAgents):
        for turn, (name, is_in) in enumerate(fact.value.turns):
            where = replace(fact.where, turn=turn)
            seen = f"{name!r}, who isn't in `agents`"
            yield Case(where, is_in, "an agent of `agents`", seen, SELECTED)


@check("GK302", HIGH, "rollout", api="aec", looks_at="an agent that ends")
def dead_agents_get_their_turn(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that ends is selected once more before it is removed, for its None turn.

    That turn is where its learner reads the last reward and that it has ended, with `last()`. An
    agent that is removed by somebody else's step, or with the step that ends it, never hears of
    either.

    Bad:
        if money[agent] <= 0:
            self.terminations[agent] = True
            self.agents.remove(agent)

    Good:
        if money[agent] <= 0:
            self.terminations[agent] = True
        ...
        self._deads_step_first()

    Fix: leave an agent that has ended in `agents` with its flag set until it was selected for its
    None step, as `self._deads_step_first()` and `self._was_dead_step(action)` do
    """
    for each, agent, has_ended in departures(evidence):
        if has_ended and not may_leave(contract, agent):  # of one without flags GK501 tells
            where = each.episode.at(each.turn + 1, agent, "agents")
            is_ok = agent == each.actor and each.is_dead
            seen = f"removed by the step of {each.actor!r}, so its end can't be read"
            proof = reproducer_of(dead_turns_are_taken)
            yield Case(where, is_ok, "removed by its own None step", seen, proof)


@check(
    "GK303",
    HIGH,
    "rollout",
    "near_limit",
    api="aec",
    looks_at="a None turn of an agent that has ended",
)
def dead_steps_remove(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A dead agent has one None turn, which removes it: it isn't selected again.

    A loop over `agent_iter()` goes on until `agents` is empty. A dead agent that stays there is
    asked again and again; its last reward is read more than once, and the loop may never end.

    Bad:
        if self.terminations[agent]:
            self.agent_selection = self._selector.next()      # and it comes round again
            return

    Good:
        if self.terminations[agent]:
            return self._was_dead_step(action)                # takes it out of `agents`

    Fix: remove a dead agent from `agents` in its None step, as `self._was_dead_step(action)` does
    """
    for play in (*aec_steps(evidence), *_steps_to_near_limits(evidence)):
        for each in play:
            if each.is_dead:
                where = each.episode.at(each.turn + 1, each.actor, "agents")
                is_ok = each.actor not in each.after
                proof = reproducer_of(dead_agent_is_removed, options=each.options)
                yield Case(where, is_ok, "gone after its None step", "still in `agents`", proof)


ROUNDS: Final = 5
"""Rounds of everybody in `agents` after which a dead agent has waited for too long."""
LEAST_TURNS: Final = 20
"""Turns of others that a dead agent may wait in any case."""


@check(
    "GK304",
    LOW,
    "rollout",
    api="aec",
    confidence=0.95,
    looks_at="an agent that has ended and stays in `agents` while others act",
)
def dead_agents_arent_kept_waiting(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A dead agent in `agents` is selected for its None turn before long, and not forgotten.

    Until then its learner doesn't know of the end, nor of its last reward. PettingZoo's own way is
    to let dead agents step first; one that waits for its turn in the order is no fault. Five rounds
    of all agents, and 20 turns at least, are; of low severity, as nothing of its reward is lost.

    Bad:
        live = [a for a in self.agents if not self.terminations[a]]
        self.agent_selection = live[self.turn % len(live)]

    Good:
        self.agent_selection = live[self.turn % len(live)]
        self._deads_step_first()

    Fix: select agents that have ended before the live ones: end step() with
    `self._deads_step_first()`
    """
    for play in aec_steps(evidence):
        yield from _waits(play)


def _waits(play: list[AecStep]) -> Cases:
    since: dict[str, int] = {}
    told: set[str] = set()
    for each in play:
        since = {agent: since.get(agent, each.turn) for agent in each.ended}
        told &= each.ended
        if each.is_dead:
            yield Case(each.episode.at(each.turn, each.actor, "agent_selection"), True)
        for agent, turn in since.items():
            most = max(LEAST_TURNS, ROUNDS * len(each.before))
            if each.turn - turn >= most and agent != each.actor and agent not in told:
                told.add(agent)
                where = each.episode.at(each.turn, agent, "agent_selection")
                seen = f"ended {each.turn - turn} turns ago, waiting"
                proof = reproducer_of(dead_agents_wait, agent=agent, most=most)
                yield Case(where, False, "selected for its None turn", seen, proof)


@check("GK305", MEDIUM, "lifecycle", api="aec")
def agent_iter_names_who_acts(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`agent_iter` names the agent that is to act, as often as it is asked to.

    Everybody plays with `for agent in env.agent_iter():`. An iterator of one's own that runs
    through the agents in its own order gives one agent's observation to another's policy.

    Bad:
        def agent_iter(self, max_iter=2**63):
            return iter(self.agents)

    Good:
        for agent in env.agent_iter():            # AECEnv's own
            observation, reward, terminated, truncated, info = env.last()

    Fix: leave `agent_iter` as `AECEnv` has it: it yields `agent_selection` until `agents` is empty,
    `max_iter` times at most
    """
    for fact in evidence.facts(IteratedAgents):
        seen = fact.value
        is_long = len(seen.named) == seen.asked
        is_ok = is_long and seen.named == seen.selected
        expected = f"{seen.asked} turns, of {seen.selected}"
        yield Case(fact.where, is_ok, expected, f"{seen.named}", fact.proof)
