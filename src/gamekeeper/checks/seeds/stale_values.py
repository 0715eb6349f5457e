"""Checks of values that were handed out: they stay, and each agent has its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from gamekeeper.checks.case import Case, Cases, Reproducer
from gamekeeper.checks.check import HIGH, MEDIUM, check
from gamekeeper.checks.facts.handed_facts import KeptValues, SharedValues
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.contract import Contract

T = TypeVar("T")
PLACES = {"observations": 0, "rewards": 1, "terminations": 2, "truncations": 3, "infos": -1}
"""Place of each part in the tuple that a Parallel environment's step returns."""


def kept_cases(evidence: ProbeEvidence, *fields: str) -> Cases:
    """Yields a case for every look at things of these kinds that were handed out earlier."""
    for fact in evidence.facts(KeptValues):
        if fact.where.field not in fields:
            continue
        changed = fact.value.changed
        fine = fact.value.looks - (changed is not None)
        for _ in range(fine):
            yield Case(fact.where, True)
        if changed is not None:
            expected = f"what was handed out at turn {changed.given} stays as it is"
            proof = _kept_proof(evidence.api, fact.where.field)
            yield Case(fact.where, False, expected, f"it has changed by turn {changed.seen}", proof)


def _of(evidence: ProbeEvidence, kind: type[T], field: str) -> Iterator[Fact[T]]:
    """Facts of a kind about one field."""
    return (fact for fact in evidence.facts(kind) if fact.where.field == field)


def _is_one_for_all(evidence: ProbeEvidence, field: str) -> bool:
    """Tells whether agents share memory that is used again: one fault, which one check tells."""
    is_shared = any(fact.value.pair for fact in _of(evidence, SharedValues, field))
    return is_shared and any(fact.value.changed for fact in _of(evidence, KeptValues, field))


def without_state(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why no value of `state()` can change: there is none, or it is plain."""
    fields = {fact.where.field for fact in evidence.facts(KeptValues)}
    return "it has no state() that hands out arrays" if fields and "state" not in fields else None


def apart_cases(evidence: ProbeEvidence, field: str) -> Cases:
    """Yields a case for every pair of agents whose memory was compared."""
    for fact in _of(evidence, SharedValues, field):
        pair = fact.value.pair
        for _ in range(fact.value.looks - fact.value.shared):
            yield Case(fact.where, True)
        if pair is not None:
            one, other = pair
            yield from [
                Case(
                    fact.where,
                    False,
                    "memory of its own for each agent",
                    f"{one!r} and {other!r} were given the same",
                    proof=_apart_proof(evidence.api, field, one, other),
                )
            ] * fact.value.shared


def _kept_proof(api: str, field: str) -> Reproducer:
    """Plays, keeps everything beside a copy, and compares at the end."""
    value = "env.state()" if field == "state" else f"out[{PLACES[field]}]"
    if api == "parallel":
        first = value if field in ("observations", "infos", "state") else "{}"
        lines = (
            "env = make()\n"
            "out = env.reset(seed=SEED)\n"
            f"value = {first}\n"
            "given = [(value, copy.deepcopy(value))]\n"
            "for actions in ACTIONS:\n"
            "    out = env.step(actions)\n"
            f"    value = {value}\n"
            "    given.append((value, copy.deepcopy(value)))\n"
        )
    else:
        lines = (
            "env = make()\n"
            "env.reset(seed=SEED)\n"
            "given = []\n"
            "for turn in range(len(ACTIONS) + 1):\n"
            "    if not env.agents:\n"
            "        break\n"
            "    out = env.last()\n"
            f"    value = {value}\n"
            "    given.append((value, copy.deepcopy(value)))\n"
            "    if turn < len(ACTIONS):\n"
            "        env.step(ACTIONS[turn])\n"
        )
    lines += "for value, copied in given:\n    np.testing.assert_equal(value, copied)"
    return Reproducer(lines, plays=False, imports=("copy",))


def _apart_proof(api: str, field: str, one: object, other: object) -> str:
    """Changes what one was given, and looks at what the other was given."""
    if api == "parallel":
        mine, theirs = f"{field}[{one!r}]", f"{field}[{other!r}]"
    elif field == "infos":
        mine, theirs = f"env.infos[{one!r}]", f"env.infos[{other!r}]"
    else:
        mine, theirs = f"env.observe({one!r})", f"env.observe({other!r})"
    return (
        "def arrays(value):\n"
        "    items = value.values() if isinstance(value, dict) else value\n"
        "    if isinstance(value, np.ndarray):\n"
        "        return [value] if value.dtype.kind in 'biufc' and value.ndim else []\n"
        "    if isinstance(value, (dict, list, tuple)):\n"
        "        return [array for item in items for array in arrays(item)]\n"
        "    return []\n"
        f"mine, theirs = {mine}, {theirs}\n"
        "assert mine is not theirs\n"
        "assert not any(np.shares_memory(a, b) for a in arrays(mine) for b in arrays(theirs))"
    )


@check(
    "GK610",
    needs=("kept",),
    severity=HIGH,
    fix="return a new array from every call (or a copy of the buffer), the mask's too",
)
def observations_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An observation that was handed out doesn't change at a later turn.

    A replay buffer keeps observations by reference. Where the environment writes the next one into
    the same array, all that was learned from the earlier ones was learned from wrong data.

    Bad:
        def observe(self, agent):
            self.planes[agent][...] = self.board == self.token[agent]
            return self.planes[agent]           # the same array at every turn

    Good:
        def observe(self, agent):
            return (self.board == self.token[agent]).astype(np.int8)
    """
    yield from kept_cases(evidence, "observations")


@check(
    "GK611",
    needs=("kept",),
    severity=MEDIUM,
    fix="build a new info for every step, with copies of arrays such as action masks",
)
def infos_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An info that was handed out, an action mask in it too, doesn't change at a later turn.

    A buffer that keeps infos, masks above all, for learning later then has those of another turn.

    Bad:
        self.infos[agent]["action_mask"] = self.legal       # one array, written to at every step

    Good:
        self.infos[agent] = {"action_mask": self.legal.copy()}
    """
    if not _is_one_for_all(evidence, "infos"):  # GK615 tells it
        yield from kept_cases(evidence, "infos")


@check(
    "GK612",
    needs=("kept",),
    severity=HIGH,
    fix="return a copy from state(): `return self.world.copy()`",
    applies=without_state,
)
def states_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Values that state() returned don't change at a later turn.

    A central critic that keeps states by reference learns from the last one alone.

    Bad:
        def state(self):
            return self.world               # the array that step() writes to

    Good:
        def state(self):
            return self.world.copy()
    """
    yield from kept_cases(evidence, "state")


@check(
    "GK613",
    needs=("kept",),
    severity=MEDIUM,
    fix="return new dictionaries from every step: `return obs, dict(self.rewards), ...`",
    api="parallel",
)
def dictionaries_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The dictionaries of rewards and endings that step returned don't change at a later step.

    A rollout that is kept step by step, as every learner does, holds the last step's rewards again
    and again. (The attributes of an AEC environment are another thing: those are written in place.)

    Bad:
        for agent in self.agents:
            self.rewards[agent] = self.score(agent)
        return observations, self.rewards, ...

    Good:
        rewards = {agent: self.score(agent) for agent in self.agents}
        return observations, rewards, ...
    """
    yield from kept_cases(evidence, "rewards", "terminations", "truncations")


@check(
    "GK614",
    needs=("kept",),
    severity=MEDIUM,
    fix="give each agent an array of its own: `{agent: view.copy() for agent in self.agents}`",
)
def observations_are_apart(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The observations of two agents share no memory that can be written to.

    A wrapper that normalises one agent's observation in place normalises the other's as well.
    Equal observations are fine in arrays of their own, or in one that is read-only, holds texts or
    has no axis.

    Bad:
        view = self.board_view()
        return {agent: view for agent in self.agents}

    Good:
        return {agent: self.board_view() for agent in self.agents}
    """
    if not _is_one_for_all(evidence, "observations"):  # GK610 tells it
        yield from apart_cases(evidence, "observations")


@check(
    "GK615",
    needs=("kept",),
    severity=MEDIUM,
    fix="`{agent: {} for agent in self.agents}`, not `dict.fromkeys(self.agents, {})`",
)
def infos_are_apart(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The infos of two agents are not one dictionary, nor do they share an array.

    An entry that is put into one agent's info, by a wrapper for instance, stands in the other's
    too.

    Bad:
        infos = dict.fromkeys(self.agents, {})

    Good:
        infos = {agent: {} for agent in self.agents}
    """
    yield from apart_cases(evidence, "infos")
