"""Checks of steps and resets out of their order, of closing, and of the agent loop."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import ended_in
from gamekeeper.checks.facts.action_facts import EndedActions
from gamekeeper.checks.facts.episode_facts import NearLimit, RaisedCall, SelectedAgents
from gamekeeper.checks.facts.lifecycle_facts import (
    Closings,
    DeadAction,
    IgnoredResets,
    LaterReset,
    ResetArguments,
    StepAfterEnd,
    StepBeforeReset,
)
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence, ProbeRun
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import closes
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode


@check("GK520", LOW, "lifecycle", looks_at="an episode that was played to its end")
def steps_end_with_the_episode(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A step after the end of an episode raises, or gives no rewards, flags or turns.

    A loop that forgets a reset else trains on an episode that isn't there. An exception of any kind
    is fine, and so are five empty dictionaries; observations alone train no learner.

    Bad:
        def step(self, actions):
            now = self.agents or self.possible_agents
            ...

    Good:
        def step(self, actions):
            if not self.agents:
                return {}, {}, {}, {}, {}

    Fix: return empty dictionaries (Parallel), or raise, once `agents` is empty
    """
    for fact in evidence.facts(StepAfterEnd):
        gave = fact.value.gave
        seen = f"the step after the end gives {gave}"
        yield Case(fact.where, not gave, "an exception, or no rewards and flags", seen, fact.proof)


@check("GK521", LOW, "lifecycle", confidence=0.8)
def steps_begin_with_a_reset(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A step before the first reset raises, or returns nothing.

    An episode that nobody has reset has no seed: it can't be played again, and its first state may
    be one that no episode begins with. An exception of any kind is fine.

    Bad:
        def __init__(self):
            self.agents = self.possible_agents[:]     # and step() plays on from here

    Good:
        def step(self, actions):
            if self.state is None:
                raise RuntimeError("call reset() before step()")

    Fix: raise an error in step() while no reset has been made
    """
    for fact in evidence.facts(StepBeforeReset):
        gave = fact.value.gave
        seen = f"the step before any reset gives {gave}"
        yield Case(fact.where, not gave, "an exception, or nothing", seen, fact.proof)


@check("GK522", MEDIUM, "lifecycle", api="aec")
def the_dead_only_pass(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A dead agent's only action is None: a real action of an agent that has ended is refused.

    A loop that forgets to look at the flags would go on choosing for an agent that isn't there any
    more, and nobody would hear of it. An exception of any kind is fine.

    Bad:
        if self.terminations[agent]:
            self._was_dead_step(None)             # whatever the action was
            return

    Good:
        if self.terminations[agent]:
            return self._was_dead_step(action)

    Fix: hand the action on: `self._was_dead_step(action)` raises where it isn't None
    """
    for fact in evidence.facts(DeadAction):
        seen = f"{fact.value.agent!r} has ended, and its action is accepted"
        yield Case(fact.where, fact.value.raised is not None, "an exception", seen, fact.proof)


UNKNOWN_SEED: Final = "unexpected keyword argument 'seed'"
"""Words of the TypeError of a reset that takes no seed."""


@check("GK523", HIGH, "lifecycle")
def resets_begin_anew(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A reset begins an episode at any time: at first, in mid-episode, at its end, twice in a row.

    Vector environments and evaluation loops reset whenever they like. A reset that raises, leaves
    nobody in `agents`, or is ignored until the episode is over, breaks them.

    Bad:
        def reset(self, seed=None, options=None):
            if self.agents:
                return self._observations, self._infos    # not over yet

    Good:
        def reset(self, seed=None, options=None):
            self.agents = self.possible_agents[:]
            self.board = new_board(self._rng)

    Fix: let reset() make the whole state new, whatever the episode before left, and name the live
    agents; where it raises, at the line that `actual` names
    """
    refusals = _seed_refusals(evidence)
    for fact in evidence.facts(LaterReset):
        raised, agents = fact.value.raised, fact.value.agents
        if raised in refusals:
            continue  # it takes no seed, which is another promise
        is_ok = raised is None and agents != 0
        seen = f"{fact.value.when}: {raised or 'nobody is in agents'}"
        yield Case(fact.where, is_ok, "a new episode that can be played", seen, fact.proof)
    for ignored in evidence.facts(IgnoredResets):
        expected = "what the first reset with this seed gave"
        seen = "a reset in mid-episode gives what stood there before it"
        yield Case(ignored.where, not ignored.value.is_ignored, expected, seen, ignored.proof)


def _seed_refusals(evidence: ProbeEvidence) -> set[str]:
    """Exceptions of reset(seed=...) where reset takes no seed, and begins an episode without."""
    asked = [fact.value.raised for fact in evidence.facts(ResetArguments)]
    begun = [raised for raised in asked if not all(raised.values())]
    told = [said or "" for raised in begun for words, said in raised.items() if "seed" in words]
    return {said for said in told if UNKNOWN_SEED in said}


REFUSED: Final = re.compile(r"^\w+: (TypeError|AssertionError|NotImplementedError)(?=:|$)")
"""Exceptions of a reset that takes no options; others may miss an entry of them."""


@check("GK524", MEDIUM, "lifecycle")
def resets_take_seed_and_options(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`reset` takes `seed` and `options` by keyword, and neither is needed.

    Wrappers, vector environments and trainers call `reset(seed=..., options=...)`; where one of
    them isn't known, they crash with a TypeError. Where no reset succeeds, with or without them,
    the arguments aren't the cause, and nothing is said of them. As options may need entries, an
    empty dictionary counts as refused only by a TypeError, an AssertionError or a
    NotImplementedError.

    Bad:
        def reset(self, seed=None): ...

    Good:
        def reset(self, seed=None, options=None): ...

    Fix: declare `def reset(self, seed=None, options=None):`
    """
    refusals = _seed_refusals(evidence)
    for fact in evidence.facts(ResetArguments):
        if all(fact.value.raised.values()):
            continue
        for words, raised in fact.value.raised.items():
            is_ok = raised is None or (words == "options={}" and not REFUSED.search(raised))
            proof = Reproducer(f"make().reset({words})", plays=False)
            expected = f"reset({words}) begins an episode"
            case = Case(fact.where, is_ok, expected, raised, proof)
            # what seeds its episodes can't play it
            yield replace(case, severity=HIGH) if raised in refusals else case


@check("GK525", LOW, "lifecycle")
def close_never_raises(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`close` raises at no time: not before a reset, and not when it is called twice.

    It is called while cleaning up, often after another error, which its own would then hide; and
    `finally` blocks, wrappers and garbage collection may call it more than once.

    Bad:
        def close(self):
            self.screen.close()                   # None before the first frame

    Good:
        def close(self):
            if self.screen is not None:
                self.screen.close()
                self.screen = None

    Fix: let close() look whether there is anything to close: `if self.screen is not None: ...`
    """
    for fact in evidence.facts(Closings):
        for when, raised in fact.value.raised.items():
            expected, times = f"close() {when} does nothing, or closes", 1 + (when == "twice")
            proof = reproducer_of(closes, resets=int(when != "before any reset"), times=times)
            yield Case(fact.where, raised is None, expected, raised, proof)


@check(
    "GK526",
    MEDIUM,
    "ended",
    api="parallel",
    looks_at="a Parallel agent that ended before the others, and an action for it",
)
def the_ended_dont_act(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that has ended acts no more: its entry in the actions is ignored or refused.

    Trainers with a fixed number of slots go on sending actions for those that are gone. Where these
    still move something, the game depends on what isn't in it. Looked at with two different actions
    of agents that have ended, and with none, everything else being equal; `state()` counts too.

    Bad:
        for agent, action in actions.items():
            self.move(agent, action)

    Good:
        for agent in self.agents:
            self.move(agent, actions[agent])

    Fix: read the actions of agents in `agents` only, or raise where there are others
    """
    for fact in evidence.facts(EndedActions):
        turn, agents = fact.value.turn, fact.value.agents
        expected = "the same episode, whatever those who ended do"
        seen = f"another one from turn {turn} on, by what {agents} did"
        yield Case(fact.where, turn is None, expected, seen, fact.proof)


EXPECTED: Final = "`last()` and None steps that raise nothing"
SHOWN: Final = {"last": "env.last()", "step": "# nothing more: the None step above raised"}


@check(
    "GK527",
    HIGH,
    "rollout",
    "near_limit",
    api="aec",
    looks_at="an agent that ends, in an episode played to its last None turn",
)
def the_loop_goes_through(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The loop over agents goes through: `last()` and the None steps of the dead raise nothing.

    `for agent in env.agent_iter()` asks whoever is in turn for `last()`, an agent that has just
    ended too: that is where its learner reads the last reward. What raises there ends every
    training, and mostly late, once somebody has ended. Judged where the agent in turn is in
    `agents`; a step of the living that raises is another promise.

    Bad:
        def observe(self, agent):
            return self.views[agent]              # whose entry went with its end

    Good:
        def observe(self, agent):
            return self.views.get(agent, self.blank)

    Fix: let `observe` answer for every agent in `agents`, also for one that has ended, and hand the
    None of a dead agent to `self._was_dead_step(action)`
    """
    for look in evidence.looks.get("rollout", ()):
        if not look.episodes:  # its process died
            continue
        raised, named = look.fact(RaisedCall), look.fact(SelectedAgents)
        yield from _loops(look, raised, named.value.turns if named else [], {})
    for look in evidence.looks.get("near_limit", ()):
        near = look.fact(NearLimit)
        if near is not None:
            call = near.value.raised
            raised = None if call is None else Fact(near.where, call)
            yield from _loops(look, raised, near.value.selected, near.value.options)


def _loops(
    look: ProbeRun,
    raised: Fact[RaisedCall] | None,
    selected: Sequence[tuple[str | None, bool]],
    options: Mapping[str, int],
) -> Cases:
    """One episode's loop: it came to its end, or something raised."""
    if raised is None:
        yield Case(_episode(look).at(None, None, "raised"), True)
    elif selected and selected[-1][1] and _is_of_the_loop(look, raised.value):
        agent = selected[-1][0]
        where = _episode(look).at(raised.where.turn, agent, "raised")
        seen = f"{raised.value.kind}: {raised.value.text}"
        proof = Reproducer(SHOWN[raised.value.call], options=options)
        yield Case(where, False, EXPECTED, seen, proof)


def _episode(look: ProbeRun) -> Episode:
    return look.episodes[0]


def _is_of_the_loop(look: ProbeRun, raised: RaisedCall) -> bool:
    """Tells whether `last()` raised, or the None step of one that had ended."""
    if raised.call == "last":
        return True
    turns = [turn for turn in _episode(look).turns if turn.raised and turn.order]
    return raised.call == "step" and any(
        agent in ended_in(turn) and turn.actions.get(agent) is None
        for turn in turns
        for agent in turn.order
    )
