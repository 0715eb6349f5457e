"""An agent's actions come out as others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.doing import Doing, Hand, does_nothing
from gamekeeper.run.stress.numbers import Floats, Numbers, are_numbers, numbers_of
from gamekeeper.run.stress.offer import Flags, Offer, offer_of
from gamekeeper.run.stress.stressor import Stressor


@dataclass(frozen=True, slots=True)
class ActionNoise(Stressor):
    """Carries out another action than the agent chose, at some turns.

    The strength is the probability, at each turn and for each whole number of an action by itself,
    that another legal value takes its place, each as likely as any other; a Box's numbers all get a
    normal number added, whose standard deviation is the strength as a part of the declared range
    (of what the agent has done so far, 0 counted, where none is declared), and stay in the space.
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.3
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Noisy(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent whose actions have no numbers."""
        offer = offer_of(contract, env, agent)
        if offer is None:
            return does_nothing(contract, env, agent)
        return (
            None
            if any(are_numbers(x.space) for x in offer.parts)
            else "its actions have no numbers"
        )


class _Noisy(Doing):
    def hand(self, offer: Offer, rng: Generator) -> Hand:
        numbers, strength = numbers_of(offer.parts), self.strength

        def do(action: Any) -> Any:
            for each in numbers:
                found = each.read(action)
                if isinstance(each.part.space, Box):
                    noise = strength * each.width * rng.standard_normal(each.size)
                    noisy = None if found is None else found + noise
                else:
                    draws = rng.random((2, each.size))
                    noisy = None if found is None else _others(each, found, draws, strength, offer)
                if noisy is not None:
                    action = each.write(action, noisy)
            return action

        return do


def _others(
    numbers: Numbers, found: Floats, draws: Floats, strength: float, offer: Offer
) -> Floats | None:
    """The numbers, with others where they are struck; None where nothing changes."""
    flags = offer.flags(numbers.part)
    changed = found.copy()
    for at in np.flatnonzero(draws[0] < strength):
        legal = _legal(numbers, int(at), flags)
        others = legal[legal != found[at]]
        if others.size:
            changed[at] = others[int(draws[1, at] * others.size)]
    return None if np.array_equal(changed, found) else changed


def _legal(numbers: Numbers, at: int, flags: tuple[Flags, ...] | None) -> Floats:
    values = np.arange(numbers.low[at], numbers.high[at] + 1)
    return values if flags is None else values[flags[at]]
