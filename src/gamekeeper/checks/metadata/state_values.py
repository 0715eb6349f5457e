"""Checks of `state()`."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from gamekeeper.checks.check import LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.effects import numbers_in
from gamekeeper.checks.facts.episode_facts import StateForms
from gamekeeper.checks.facts.state_facts import (
    LateState,
    StateAnswer,
    StateAnswers,
    StateSpace,
    UsedState,
)
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import (
    state_has_dtype,
    state_has_shape,
    state_keeps_dtype,
    state_keeps_shape,
    states_are_current,
    states_forget,
    states_move,
)
from gamekeeper.checks.spaces.observation_values import misfit_cases
from gamekeeper.contract import Contract
from gamekeeper.episodes.spaces.misfit import DTYPE
from gamekeeper.episodes.where import Where

LEAST_PARTS: Final = 10
"""Observations that are found in state()."""


def stateless(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why there is no state to judge; None where there is, or where none was asked for."""
    facts = list(evidence.facts(StateSpace))
    if not facts or any(fact.value.is_there for fact in facts):
        return None
    return "it has no state(), which is optional"


def space_of(evidence: ProbeEvidence, play: int) -> StateSpace:
    """The declared space of the play's state."""
    facts = list(evidence.facts(StateSpace))
    own = [fact for fact in facts if fact.where.play == play] or facts
    return own[0].value if own else StateSpace(is_there=False, space=None, shape=None, dtype=None)


def answers(evidence: ProbeEvidence) -> Iterator[tuple[Fact[Any], StateAnswer]]:
    """Every answer that state() gave or should have given, with the fact of its play."""
    for fact in evidence.facts(StateAnswers):
        for answer in fact.value.answers:
            yield fact, answer


def forms(evidence: ProbeEvidence) -> Iterator[tuple[Fact[Any], StateAnswer]]:
    """Every answer, and of rollouts, which are longer, the first one of each form."""
    yield from answers(evidence)
    if any(fact.value.is_there for fact in evidence.facts(StateSpace)):
        for fact in evidence.facts(StateForms):
            for answer in fact.value.answers:
                yield fact, answer


def answer_at(fact: Fact[Any], answer: StateAnswer, field: str = "state") -> Where:
    """The place of an answer."""
    return replace(fact.where, turn=answer.turn, field=field)


def is_of_observations(evidence: ProbeEvidence, kind: str) -> bool:
    """Tells whether state() is made of observations that miss their space in the same way.

    Then one fault is in both, of which the check of observations tells.
    """
    looks = [
        any(np.array_equal(part, row) for row in state.reshape(-1, len(part)))
        for episode in evidence["rollout"][:1]
        for turn in episode.turns
        for state in (numbers_in(turn.state),)
        for part in map(numbers_in, turn.observations.values())
        if len(state) and len(part) and len(state) % len(part) == 0
    ]
    is_made = len(looks) >= LEAST_PARTS and all(looks)
    return is_made and not all(each.ok for each in misfit_cases(evidence, kind))


@check("GK811", MEDIUM, "state", "rollout", applies=stateless)
def states_have_their_shape(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() has the shape of state_space, and without one a shape that it keeps.

    A critic's network has one input. Rows of agents that have ended are zero, not gone.

    Bad:
        return np.concatenate([self.row(agent) for agent in self.agents])

    Good:
        return np.concatenate([self.row(agent) for agent in self.possible_agents])

    Fix: make state() of one shape, whoever is still alive, and declare it in state_space
    """
    firsts: dict[tuple[str, int], list[int]] = {}
    for fact, answer in forms(evidence):
        play = fact.where.probe, fact.where.play
        if answer.failed is not None:
            continue
        shape, declared = answer.shape, space_of(evidence, fact.where.play)
        if declared.shape is not None:
            expected, proof = list(declared.shape), reproducer_of(state_has_shape)
        elif declared.space is None and shape is not None:
            expected, proof = firsts.setdefault(play, shape), reproducer_of(state_keeps_shape)
        else:
            continue
        seen = f"a {answer.kind}" if shape is None else shape
        yield Case(answer_at(fact, answer), shape == expected, expected, seen, proof=proof)


@check("GK812", MEDIUM, "state", "rollout", applies=stateless)
def states_have_their_dtype(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() has the dtype of state_space, and without one a dtype that it keeps.

    Buffers are allocated after the space: a float64 loses digits in them, or is refused. What
    the space contains all the same, as zeros and ones in a MultiBinary, is of low severity.

    Bad:
        return np.concatenate(rows)                       # float64

    Good:
        return np.concatenate(rows, dtype=np.float32)     # as state_space says

    Fix: state().astype(self.state_space.dtype)
    """
    if is_of_observations(evidence, DTYPE):
        return
    firsts: dict[tuple[str, int], object] = {}
    for fact, answer in forms(evidence):
        play = fact.where.probe, fact.where.play
        dtype, declared = answer.dtype, space_of(evidence, fact.where.play)
        if answer.failed is not None or dtype is None:
            continue
        if declared.space is not None and declared.dtype is None:
            continue
        expected = declared.dtype or firsts.setdefault(play, dtype)
        proof = reproducer_of(state_has_dtype if declared.dtype else state_keeps_dtype)
        where = answer_at(fact, answer, "state.dtype")
        case = Case(where, dtype == expected, expected, dtype, proof)
        is_binary = answer.is_within and str(declared.space).startswith("MultiBinary")
        is_taken = is_binary or (declared.dtype and np.can_cast(dtype, declared.dtype))
        yield replace(case, severity=LOW) if is_taken else case


WITHIN = "state = env.state()\nassert env.state_space.contains(state), (state, env.state_space)"
NUMBER = "state = env.state()\nassert not np.isnan(state).any(), state"


@check("GK813", MEDIUM, "state", "rollout", applies=stateless)
def states_are_within_bounds(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() lies within the bounds of state_space, and is never NaN.

    Normalisation relies on the bounds; one NaN makes a critic's weights NaN for good.

    Bad:
        self.state_space = Box(0, 1, (4,))
        return self.cells / 4          # up to 1.25

    Good:
        return self.cells / 5

    Fix: scale state(), or widen state_space to what it can be; keep NaN out of both
    """
    for fact, answer in forms(evidence):
        if answer.has_nan:
            where = answer_at(fact, answer, "state.nan")
            yield Case(where, False, "numbers", "NaN", NUMBER)
        elif answer.is_within is not None:
            space = space_of(evidence, fact.where.play).space
            seen = "a value in it" if answer.is_within else "a value outside"
            is_ok = answer.is_within
            yield Case(answer_at(fact, answer, "state.bounds"), is_ok, f"in {space}", seen, WITHIN)
        elif answer.dtype is not None:
            yield Case(answer_at(fact, answer, "state.nan"), True, "numbers", "numbers", NUMBER)


STATE_TWICE_PROOF = (
    "first, second = env.state(), env.state()\n"
    "assert np.array_equal(first, second), 'state() is another when it is asked again'"
)


@check("GK814", MEDIUM, "state", applies=stateless)
def states_are_the_same_asked_twice(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() says the same when it is asked twice at one moment: it neither draws nor counts.

    A value that differs from one call to the next isn't the environment's state; if it is drawn
    from the game's own generator, calling state() also changes the future.

    Bad:
        return self.table() + self.rng.normal(0, 0.01, 12)

    Good:
        return self.table()

    Fix: make state() a function of the environment's state alone; noise belongs into observations,
    drawn in step()
    """
    for fact, answer in answers(evidence):
        if answer.failed is None:
            is_same = answer.digest == answer.again
            seen = "the same" if is_same else "another"
            yield Case(
                answer_at(fact, answer), is_same, "the same state twice", seen, STATE_TWICE_PROOF
            )


@check("GK815", MEDIUM, "state", applies=stateless)
def states_forget_the_last_episode(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() is of this episode alone: after a reset nothing of the last one stands in it.

    The same episode is played twice in one instance. Where all observations and rewards are equal,
    so must be the states.

    Bad:
        def state(self):
            if self.kept is None:
                self.kept = self.table()
            return self.kept             # step() forgets it, reset() doesn't

    Good:
        def reset(self, seed=None, options=None):
            self.kept = None

    Fix: forget in reset() whatever state() keeps
    """
    proof = reproducer_of(states_forget, compares=True)
    for fact in evidence.facts(UsedState):
        is_same = fact.value.turn is None
        seen = "the same" if is_same else "another"
        yield Case(fact.where, is_same, "the state that the same episode had before", seen, proof)


LEAST_MOVES: Final = 8
"""Turns at which observations changed, before a state that stays says anything."""


@check("GK816", MEDIUM, "state", confidence=0.9, applies=stateless)
def states_follow_the_game(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() follows the episode: while observations change, it changes too.

    A central critic learns nothing from a state that stands still. Only plays in which somebody's
    observation changed at eight turns or more are looked at; one other state in any play is enough.

    Bad:
        def state(self):
            return self.start_table

    Good:
        def state(self):
            return self.table()

    Fix: make state() from what step() changes
    """
    looks = [
        (fact, {a.digest for a in fact.value.answers if a.failed is None})
        for fact in evidence.facts(StateAnswers)
        if fact.value.moves >= LEAST_MOVES
    ]
    looks = [(fact, states) for fact, states in looks if states]
    if looks:
        is_ok = any(len(states) > 1 for _, states in looks)
        where = replace(looks[0][0].where, turn=None, field="states")
        proof = reproducer_of(states_move)
        seen = "it changes" if is_ok else "one state from the reset to the end"
        yield Case(where, is_ok, "states that change as the game moves", seen, proof)


LEAST_TRIALS: Final = 4


@check("GK817", MEDIUM, "state", confidence=0.8, applies=stateless)
def states_are_not_late(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() shows what a step has done at once, not a turn late.

    Another legal action is played at one turn. Where observations show the difference at once in
    four trials or more, while state() never does, and mostly does one turn later, it is late.

    Bad:
        def step(self, actions):
            self.kept = self.table()     # before anybody has moved
            ...

    Good:
        def state(self):
            return self.table()

    Fix: make state() of what the step has led to, not of what it came from
    """
    for fact in evidence.facts(LateState):
        trials, later = fact.value.trials, fact.value.later
        if fact.value.at_once:
            yield Case(fact.where, True, "shown at once", "shown at once")
        elif trials >= LEAST_TRIALS and later > trials / 2:
            seen = f"in none of {trials} trials, and in {later} of them a turn later"
            other = fact.value.other or {}
            other = other if evidence.api == "parallel" else next(iter(other.values()))
            proof = reproducer_of(states_are_current, turn=fact.value.turn, other=other)
            yield Case(fact.where, False, "shown at once", seen, proof)


@check("GK818", MEDIUM, "state", applies=stateless)
def states_answer_all_along(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """state() returns at every turn, where it is implemented.

    Collectors ask for it after every step. What it does once the episode is over isn't judged.

    Bad:
        return np.concatenate([self.rows[agent] for agent in self.possible_agents])   # KeyError

    Good:
        return np.concatenate([self.row(agent) for agent in self.possible_agents])

    Fix: let state() answer at any time after reset(), whoever is still alive
    """
    for fact, answer in answers(evidence):
        failed = answer.failed
        if failed is None or not answer.over:
            where = answer_at(fact, answer)
            yield Case(where, failed is None, "a state", failed or "a state", "env.state()")
