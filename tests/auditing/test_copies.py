"""Copies and conversions: what is refused, what begins anew, what is lost."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from gymnasium.utils import EzPickle

from gamekeeper.auditing.audit import audit_here
from gamekeeper.checks.reproducers import becomes_parallel
from gamekeeper.reporting.audit_text import minor_text
from tests.faults.lanterns import Lanterns
from tests.faults.rovers import Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders

COPIES = ("GK701", "GK702", "GK703")


def outcomes(spec: object, *ids: str) -> dict[str, str]:
    """The outcomes of these checks."""
    found = audit_here(spec, select=ids, budget=300)
    return {verdict.id: verdict.outcome for verdict in found.verdicts}


@pytest.mark.parametrize("kind", [Rovers, Traders, Tokens, Lanterns])
def test_copies_of_clean_environments_are_kept(kind: Any) -> None:
    """Environments without tricks are copied in mid-episode, in both ways."""
    assert outcomes(kind, *COPIES) == dict.fromkeys(COPIES, "passed")


class Refusing(Rovers):
    """Can't be copied, and says so."""

    def __reduce_ex__(self, protocol: Any) -> Any:
        """No."""
        raise TypeError("this environment can't be copied")


def test_refusing_to_be_copied_is_minor() -> None:
    """Nobody promises that an environment can be copied; who needs it is told that it can't be."""
    found = audit_here(Refusing, select=COPIES, budget=300)
    assert {"not_applicable"} == {found.of(id).outcome for id in COPIES}
    assert "can't be copied" in minor_text(found.to_json(), width=300)
    anew = audit_here(Anew, select=COPIES, budget=300)
    assert minor_text(anew.to_json(), width=300) == ""


class Anew(EzPickle, Rovers):
    """Its copies are built from the same arguments."""

    def __init__(self) -> None:
        EzPickle.__init__(self)
        Rovers.__init__(self)


class Ready(Anew):
    """Its constructor begins an episode, so that a copy can be stepped at once."""

    def __init__(self) -> None:
        super().__init__()
        self.reset(seed=0)


class Herself(Ready):
    """Says what is pickled, and how it comes back: with empty batteries."""

    def __getstate__(self) -> dict[str, Any]:
        """All there is."""
        return vars(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """With other batteries."""
        self.__dict__.update(state)
        self.battery = dict.fromkeys(state["battery"], 1)


@pytest.mark.parametrize("kind", [Anew, Ready])
def test_copies_that_begin_anew_are_not_applicable(kind: Any) -> None:
    """A copy from the constructor's arguments, as EzPickle makes it, is no copy of the episode."""
    assert outcomes(kind, *COPIES) == dict.fromkeys(COPIES, "not_applicable")


def test_copies_that_an_environment_makes_itself_are_judged() -> None:
    """To inherit from EzPickle excuses nothing where the class says what is copied."""
    assert outcomes(Herself, "GK703") == {"GK703": "failed"}


class Halting(Rovers):
    """Its copies can't be stepped: something that can't be copied was left out."""

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the cells."""
        return {name: value for name, value in vars(self).items() if name != "cells"}


def test_copies_that_cannot_be_stepped_are_not_applicable() -> None:
    """A copy that raises at once misleads nobody."""
    assert outcomes(Halting, *COPIES) == dict.fromkeys(COPIES, "not_applicable")


class Shared(Traders):
    """Its generator belongs to the class."""

    dice: Any = None

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """One generator for all."""
        super().reset(seed, options)
        type(self).dice = np.random.default_rng(seed)

    def settle(self) -> None:
        """Somebody finds a coin."""
        super().settle()
        finder = self.possible_agents[int(type(self).dice.integers(self.count))]
        self.money[finder] += 1


def test_what_belongs_to_the_class_moves_with_every_copy() -> None:
    """A generator of the class is drawn from by the copy, so the original goes another way."""
    assert outcomes(Shared, "GK702") == {"GK702": "failed"}


class Sudden(Lanterns):
    """One action of twelve, of the first keeper, ends its only round for all in mid-cycle."""

    def __init__(self) -> None:
        super().__init__(rounds=1)
        self._done = {agent: Discrete(12) for agent in self.possible_agents}

    def step(self, action: Any) -> None:
        """Ends where the first keeper draws a 1."""
        is_over = action == 1 and self.agent_selection == self.possible_agents[0]
        super().step(None if action is None else action % 4)
        if is_over:
            self.terminations = dict.fromkeys(self.agents, True)


def test_program_of_a_conversion_plays_until_a_rare_action_was_drawn() -> None:
    """The first of its episodes alone doesn't show a death in mid-cycle."""
    assert Discrete(12, seed=0).sample() != 1
    with pytest.raises(ValueError, match="agent is dead"):
        becomes_parallel(Sudden, 1)
    becomes_parallel(Lanterns, 1)


def test_conversion_is_asked_only_where_it_is_promised() -> None:
    """An environment that doesn't call itself parallelizable promises nothing."""
    ids = ("GK710", "GK711")
    assert outcomes(Traders, *ids) == dict.fromkeys(ids, "not_applicable")
    assert outcomes(Rovers, *ids) == dict.fromkeys(ids, "not_applicable")
    assert outcomes(Lanterns, *ids) == dict.fromkeys(ids, "passed")
