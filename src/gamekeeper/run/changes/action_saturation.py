"""Actuators that are weaker than they should be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.doing import Doing, Hand, does_nothing
from gamekeeper.run.stress.numbers import Floats, Numbers, numbers_of
from gamekeeper.run.stress.offer import Offer, offer_of
from gamekeeper.run.stress.stressor import Stressor, Unit

NOT_CONTINUOUS: Final = "its actions are no numbers between bounds"


@dataclass(frozen=True, slots=True)
class ActionSaturation(Stressor):
    """Cuts a Box's numbers off within a narrower range than is declared.

    The range shrinks towards the declared noop; where there is none, towards 0 or what is nearest
    to it. The strength is the part of the range that is lost: at 1 only the noop is left.
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.5
    UNIT: ClassVar[Unit] = "part"
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Saturated(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Only to an agent whose actions are numbers of a bounded Box."""
        offer = offer_of(contract, env, agent)
        if offer is None:
            return does_nothing(contract, env, agent)
        return None if _continuous(offer) else NOT_CONTINUOUS


class _Saturated(Doing):
    def hand(self, offer: Offer, rng: Generator) -> Hand:
        ranges = [(each, *_range(each, offer, 1 - self.strength)) for each in _continuous(offer)]

        def do(action: Any) -> Any:
            for each, low, high in ranges:
                found = each.read(action)
                if found is None:
                    continue
                cut = np.clip(found, low, high)
                if not np.array_equal(cut, found, equal_nan=True):
                    action = each.write(action, cut)
            return action

        return do


def _continuous(offer: Offer) -> list[Numbers]:
    found = numbers_of(part for part in offer.parts if isinstance(part.space, Box))
    return [each for each in found if each.is_bounded.any()]


def _range(numbers: Numbers, offer: Offer, left: float) -> tuple[Floats, Floats]:
    still = numbers.read(offer.noop(None)) if offer.has_noop else None
    centre = numbers.blank() if still is None else still
    ends = (np.where(numbers.is_bounded, end, centre) for end in (numbers.low, numbers.high))
    low, high = (centre + (end - centre) * left for end in ends)
    bounded = numbers.is_bounded
    return np.where(bounded, low, numbers.low), np.where(bounded, high, numbers.high)
