"""Check of action masks beside what actions do: of another agent, of another moment, inverted."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gamekeeper.checks.check import HIGH, Case, Cases, check
from gamekeeper.checks.facts.action_facts import MaskTrial
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.spaces.action_masks import without_masks
from gamekeeper.contract import Contract

LEAST: Final = 4
"""Actions of each kind that contradict a mask."""
ONE_KIND: Final = 8
"""Void ones, where nothing that it forbids has an effect."""


def step_outcome(make: Any, seed: Any, actions: Any, turn: int, agent: Any, choice: Any) -> Any:
    """Result of a step with another choice of one agent; None where it raises."""
    env = make()
    env.reset(seed=seed)
    try:
        for each in actions[:turn]:
            env.step(each)
        if isinstance(actions[turn], dict):
            out = env.step({**actions[turn], agent: choice})
            return copy.deepcopy(list(out[:4]))
        env.step(choice)
        books = env.rewards, env.terminations, env.truncations, env.agent_selection
        return copy.deepcopy([*books, {each: env.observe(each) for each in env.agents}])
    except Exception:
        return None


def is_equal(one: Any, two: Any) -> bool:
    """Tells whether two outcomes are equal."""
    try:
        np.testing.assert_equal(one, two)
    except AssertionError:
        return False
    return True


def assert_mask_fits(
    make: Any, seed: Any, actions: Any, nothing: Any, effect: Any, agents: Any
) -> None:
    """Raises where an allowed action has no effect of its own, and a forbidden one has."""
    turn, allowed, others = nothing
    none = step_outcome(make, seed, actions, turn, agents[0], allowed)
    is_void = any(
        is_equal(none, step_outcome(make, seed, actions, turn, agents[0], each)) for each in others
    )
    assert not (is_void and effect is None), "a mask allows what is void"
    if effect is None:
        return
    turn, forbidden, others = effect
    some = step_outcome(make, seed, actions, turn, agents[1], forbidden)
    is_taken = some is not None and not any(
        is_equal(some, step_outcome(make, seed, actions, turn, agents[1], each)) for each in others
    )
    assert not (is_void and is_taken), "a mask allows what is void, and forbids what is taken"


@dataclass(frozen=True, slots=True)
class _Contradiction:
    """An action that a mask is wrong about, if another mask is right.

    Attributes:
        is_allowed: by the mask that was given; the action is void then, else it is taken.
        place: of the action in the trial.
    """

    fact: Fact[MaskTrial]
    is_allowed: bool
    place: int


@check(
    "GK238",
    HIGH,
    "mask_trials",
    confidence=0.9,
    applies=without_masks,
    looks_at="a turn of an agent with a mask of a Discrete space, at which each action was tried",
)
def masks_say_what_is_legal_now(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An action mask says what its own agent can do now: it is no other agent's or moment's.

    An environment that takes every action in silence doesn't tell that a mask is wrong: a learner
    is kept from what it could do, and sent to what does nothing.

    Measured by trying every action at a turn. An action is void where its step gives the same as
    another one's. It is broken only where another mask that the environment gives (the next
    agent's, that of a later turn, the inverted one) is right about each action on which the
    two differ, in all trials: at least four that the given mask allows are void, and at least four
    that it forbids have an effect of their own. A mask that merely advises is contradicted by both.
    In an AEC environment eight void ones are enough where the other mask explains all that is
    void: what it allows has an effect, but for an action that it always allows.

    Bad:
        mask = self.legal[self.agents.index(agent) - 1]       # and step() ignores what is illegal

    Good:
        mask = self.legal_now(agent)

    Fix: make the mask from the state that the action will meet, for the agent that will act
    """
    facts = evidence.facts(MaskTrial)
    for source in sorted({name for fact in facts for name in fact.value.others}):
        shown = _shown(evidence.api, source, facts)
        if shown is not None:
            yield _case(source, *shown)
            return
    for fact in facts:
        yield Case(fact.where, True)


def _contradictions(source: str, facts: Sequence[Fact[MaskTrial]]) -> list[_Contradiction]:
    """Actions on which a source is right and the given masks wrong; none if it ever is wrong."""
    found = []
    for fact in facts:
        other = fact.value.others.get(source)
        if other is None:
            continue
        for place, (given, right) in enumerate(zip(fact.value.given, other, strict=True)):
            if given == right:
                continue
            if fact.value.is_alone(place) is bool(given):
                return []
            found.append(_Contradiction(fact, bool(given), place))
    return found


def _shown(
    api: str, source: str, facts: Sequence[Fact[MaskTrial]]
) -> tuple[_Contradiction, _Contradiction | None] | None:
    """A void and a taken action of one episode, where there are enough; None: nothing is shown."""
    wrong = _contradictions(source, facts)
    void, taken = ([each for each in wrong if each.is_allowed is kind] for kind in (True, False))
    if min(len(void), len(taken)) >= LEAST:
        pairs = ((v, t) for v in void for t in taken if v.fact.where.play == t.fact.where.play)
        return next(pairs, None)
    void = [each for each in void if _illegal_alike(each, source)]
    if api == "aec" and len(void) >= ONE_KIND and not taken and _explains(source, facts):
        return void[0], None
    return None


def _illegal_alike(one: _Contradiction, source: str) -> list[Any]:
    """Actions that both masks forbid, and that do the same as this one."""
    trial = one.fact.value
    rows = zip(trial.actions, trial.classes, trial.given, trial.others[source], strict=True)
    return [
        act for act, kind, *flags in rows if kind == trial.classes[one.place] and not any(flags)
    ]


def _explains(source: str, facts: Sequence[Fact[MaskTrial]]) -> bool:
    """Tells whether all that a mask allows has an effect, but for what it always allows."""
    trials = [fact.value for fact in facts if source in fact.value.others]
    closed = {
        int(action)
        for trial in trials
        for action, flag in zip(trial.actions, trial.others[source], strict=True)
        if not flag
    }
    return all(
        trial.is_alone(place) or int(trial.actions[place]) not in closed
        for trial in trials
        for place, flag in enumerate(trial.others[source])
        if flag
    )


def _case(source: str, void: _Contradiction, taken: _Contradiction | None) -> Case:
    at, rest = void.fact.where, _rest(void) if taken else _illegal_alike(void, source)
    seen = (
        f"{at.agent!r} is allowed {void.fact.value.actions[void.place]} at turn {at.turn}, which "
        f"does the same as {'another' if taken else 'a forbidden'} action"
    )
    if taken is not None:
        at = taken.fact.where
        seen += (
            f"; {at.agent!r} is forbidden {taken.fact.value.actions[taken.place]} at turn "
            f"{at.turn}, which has an effect of its own"
        )
    proof = reproducer_of(
        assert_mask_fits,
        nothing=(void.fact.where.turn, void.fact.value.actions[void.place], rest),
        effect=taken and (at.turn, taken.fact.value.actions[taken.place], _rest(taken)),
        agents=[each.fact.value.agent for each in (void, taken) if each is not None],
    )
    expected = "a mask of what the agent can do now"
    return Case(at, False, expected, f"{seen}; {source} is right in all trials", proof)


def _rest(one: _Contradiction) -> list[Any]:
    """The other actions of the trial."""
    return [each for place, each in enumerate(one.fact.value.actions) if place != one.place]
