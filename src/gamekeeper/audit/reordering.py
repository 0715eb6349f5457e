"""Whether another order of the actions changes what happens, or only who gets which draw."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from gamekeeper.audit.lab import Lab
from gamekeeper.audit.outcomes import Key, digests, numbers, stacked
from gamekeeper.core.stats import FloatArray, permutation_test, sign_flip_test
from gamekeeper.game.capture.stillness import is_still
from gamekeeper.run.changes.action_order import reordered
from gamekeeper.run.episode import Play
from gamekeeper.run.reseed import kept_global_generators, reseed

SAMPLES: Final = 20
"""Outcomes of each order that are drawn where copies can be had."""
FEWEST: Final = 8
"""Fewer say too little: 8 against 8 can still have a p-value of 1 / 12,870."""
ROUNDS: Final = 4_999
"""Permutations; the least p-value is 1 / 5,000, so that it survives a correction for looks."""
MOST_STATES: Final = 48
"""States at which a fault that hides behind draws is looked for."""

Numbers = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class Told:
    """What a difference was told to be.

    Attributes:
        result: `outcome` (nothing was drawn), `draws` (something was: the tests tell), `undecided`,
            `noise` (led there once more, the first order gives something else too).
        p_values: of the tests whether both orders have one distribution.
    """

    result: str
    p_values: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Parting:
    """A play in which the other order parts from the first.

    Attributes:
        play: its actions are on paper.
        order: the name of the other order.
        turn: crossings after which the difference shows.
        seen: digests of what the first order gave there.
    """

    play: Play
    order: str
    turn: int
    seen: Mapping[Key, bytes]


def told(lab: Lab, parting: Parting) -> Told:
    """Reruns the play up to the parting, and says what the order of the actions changes.

    Nothing was drawn: it is the outcome. Else both orders are given the same number of fresh
    random futures from the same state, and a permutation test over all numbers of the outcome says
    whether they have one distribution; where they seem to, fault that comes rarely is looked for
    at other states of the play.
    """
    with kept_global_generators():
        drawn = _drawn(lab, parting)
        if not drawn:
            return Told("noise" if drawn is None else "outcome")
        bench = _Bench(lab, parting)
        first = bench.at_the_parting()
        if first is None:
            return Told("undecided")
        rest = bench.elsewhere() if first > 1 / 100 else None
    return Told("draws", (first,) if rest is None else (first, rest))


def _drawn(lab: Lab, parting: Parting) -> bool | None:
    """Whether any generator moves in the crossing before the parting; None: it is mere noise."""
    found = False
    for order in ("", "", parting.order):
        env = _led(lab, parting, parting.turn - 1)
        actions = _ordered(parting.play, order, parting.turn - 1)
        outs: list[Any] = []
        is_calm = is_still(env, partial(_stepped, lab, env, actions, outs))
        if not order and digests(outs[0], lab.contract.volatile_infos()) != parting.seen:
            return None
        found = found or not is_calm
    return found


def _stepped(lab: Lab, env: Any, actions: Mapping[Any, Any], outs: list[Any]) -> None:
    outs.append(lab.step(env, actions).value)


class _Bench:
    """Samples of both orders from one state on."""

    def __init__(self, lab: Lab, parting: Parting) -> None:
        self._lab, self._parting = lab, parting
        self._volatile = lab.contract.volatile_infos()
        self._rng = np.random.default_rng([11, lab.number])
        self._left = max(lab.ration, 400)

    def at_the_parting(self) -> float | None:
        """The p-value of both orders having one distribution there; None: it can't be known."""
        turn, lab = self._parting.turn, self._lab
        begun = self._cause()
        env = _led(lab, self._parting, begun)
        can_copy = _copies_well(lab, env, _ordered(self._parting.play, "", begun))
        each = turn - begun if can_copy else turn
        size = min(SAMPLES, self._left // max(2 * each, 1))
        if size < FEWEST:
            return None
        found: dict[str, list[Numbers]] = {"": [], self._parting.order: []}
        if can_copy:
            env = _led(lab, self._parting, begun)
        for number in range(size):
            for side, order in enumerate(found):
                one = copy.deepcopy(env) if can_copy else _led(lab, self._parting, begun)
                reseed(one, 2 * number + side)
                found[order].append(self._onward(one, begun, order))
        values = stacked([*found[""], *found[self._parting.order]])
        return permutation_test(values[:size], values[size:], rng=self._rng, rounds=ROUNDS)

    def elsewhere(self) -> float | None:
        """The same over states along the play; None where copies can't be had."""
        lab, actions = self._lab, self._parting.play.actions or ()
        env = _led(lab, self._parting, 0)
        step = max(len(actions) // MOST_STATES, 1)
        pairs: list[Numbers] = []
        for turn in range(len(actions)):
            if turn % step == 0 and len(getattr(env, "agents", ())) > 1:
                if turn == 0 and not _copies_well(lab, _led(lab, self._parting, 0), actions[0]):
                    return None
                for side, order in enumerate(("", self._parting.order)):
                    one = copy.deepcopy(env)
                    reseed(one, 1_000 + 2 * turn + side)
                    pairs.append(self._numbers(one, _ordered(self._parting.play, order, turn)))
            lab.step(env, actions[turn])
        if len(pairs) < 2 * FEWEST:
            return None
        values = stacked(pairs)
        return sign_flip_test(values[::2] - values[1::2], rng=self._rng, rounds=ROUNDS)

    def _cause(self) -> int:
        """The crossing whose order makes the difference: the last before it, or all of them."""
        turn, outs = self._parting.turn, []
        for order in ("", self._parting.order):
            env = _led(self._lab, self._parting, turn - 1)
            out = self._lab.step(env, _ordered(self._parting.play, order, turn - 1)).value
            outs.append(digests(out, self._volatile))
        return turn - 1 if outs[0] != outs[1] else 0

    def _onward(self, env: Any, begun: int, order: str) -> Numbers:
        for turn in range(begun, self._parting.turn - 1):
            self._lab.step(env, _ordered(self._parting.play, order, turn))
        return self._numbers(env, _ordered(self._parting.play, order, self._parting.turn - 1))

    def _numbers(self, env: Any, actions: Mapping[Any, Any]) -> Numbers:
        return numbers(self._lab.step(env, actions).value, self._volatile)


def _led(lab: Lab, parting: Parting, turns: int) -> Any:
    """An environment to which the first `turns` of the play have happened."""
    env = lab.env()
    lab.meter.count()
    lab.call("reset", env.reset, seed=parting.play.seed)
    for turn in range(turns):
        lab.step(env, _ordered(parting.play, "", turn))
    return env


def _copies_well(lab: Lab, env: Any, actions: Mapping[Any, Any]) -> bool:
    """Whether a copy goes on as its original does, for a step at least."""
    twin = lab.call("deepcopy", copy.deepcopy, env)
    if twin.failed is not None:
        return False
    outs = [lab.step(one, copy.deepcopy(actions)) for one in (twin.value, env)]
    return outs[0].failed is None and digests(outs[0].value) == digests(outs[1].value)


def _ordered(play: Play, order: str, turn: int) -> dict[Any, Any]:
    """Copies of the actions of a turn, in that order; in their own where none is named."""
    actions = (play.actions or ())[turn]
    names = reordered(order, list(actions), turn) if order else list(actions)
    return {agent: copy.deepcopy(actions[agent]) for agent in names}


def orders(count: int, play: int) -> tuple[str, ...]:
    """The orders that are worth a look in a play of so many agents; reversed covers every pair."""
    return ("reversed", "shuffled") if count > 2 and play % 4 == 0 else ("reversed",)
