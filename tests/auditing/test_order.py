"""The order of the action dictionary: no difference, draws, or the outcome."""

from functools import partial
from typing import Any

import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.contract import Contract
from tests.auditing.small_games import Grab, Summed

SELECT = ("GK311", "GK312")


def outcomes(spec: Any, **options: Any) -> tuple[str, str]:
    """What the two checks come to."""
    found = audit_here(spec, select=SELECT, budget=400, **options)
    assert [v.reason for v in found.verdicts if v.outcome == "error"] == []
    return found.of("GK311").outcome, found.of("GK312").outcome


@pytest.mark.parametrize("rule", ["none", "draw"])
def test_order_free_rules_are_kept(rule: str) -> None:
    """Conflicts that are settled without the dictionary's order break nothing."""
    assert outcomes(partial(Grab, rule)) == ("passed", "passed")


def test_first_in_the_dictionary_is_an_outcome() -> None:
    """Who stands first wins: that is another game, whatever the seed."""
    assert outcomes(partial(Grab, "first"))[0] == "failed"


def test_dice_in_the_dictionarys_order_are_draws() -> None:
    """All have the same chances, so only who gets which draw has changed."""
    assert outcomes(partial(Grab, "dice")) == ("passed", "failed")


def test_an_outcome_behind_draws_is_found() -> None:
    """Dice that favour the first in the dictionary are an outcome, though something is drawn."""
    assert outcomes(partial(Grab, "biased"))[0] == "failed"


def test_last_digits_are_no_outcome() -> None:
    """Sums of floats that differ by rounding change no game."""
    assert outcomes(Summed) == ("passed", "passed")


def test_one_agent_has_no_order() -> None:
    """A dictionary of one entry gives nothing to look at."""
    assert outcomes(partial(Grab, "first", (7,))) == ("not_exercised", "not_exercised")


def test_an_object_is_enough() -> None:
    """Everything is played in the one instance that was handed over."""
    assert outcomes(Grab("first"))[0] == "failed"


def test_an_order_by_declaration_is_not_judged() -> None:
    """A contract that says who acts first settles conflicts."""
    contract = Contract.from_json({"schedule": {"conflicts": "ordered"}})
    assert outcomes(partial(Grab, "first"), contract=contract)[0] == "not_applicable"


def test_what_no_seed_settles_is_not_blamed_on_the_order() -> None:
    """An environment that differs from rerun to rerun says nothing of its order."""

    class Moody(Grab):
        calls = 0

        def _winner(self, asking: list[Any]) -> Any:
            Moody.calls += 1
            return self.agents[(Moody.calls // 5) % 3]

    assert outcomes(Moody) == ("not_exercised", "not_exercised")


def test_an_outcome_in_a_game_that_cant_be_copied_is_found() -> None:
    """Where copies are refused, plays are led to the same place again."""

    class Uncopied(Grab):
        def __deepcopy__(self, memo: Any) -> Any:
            raise TypeError("no copies")

    assert outcomes(partial(Uncopied, "biased"))[0] == "failed"
    assert outcomes(partial(Uncopied, "dice"))[1] == "failed"


def test_global_generators_are_left_alone() -> None:
    """Reseeding in the audit doesn't move the caller's random numbers."""
    import random

    random.seed(5)
    before = random.getstate()
    outcomes(partial(Grab, "dice"))
    assert random.getstate() == before
