"""One fault has one cause: what else it breaks passes once it is held still, and nothing else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Tuple

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.audit_process import audit
from gamekeeper.auditing.draw_holds import ids_held
from gamekeeper.auditing.holds import bounds_held, containers_of, set_in
from gamekeeper.checks.object_ids import ids_from
from tests.auditing import linked_games
from tests.auditing.linked_games import ByAddress
from tests.faults import tokens

GAMES = "tests.auditing.linked_games"


@pytest.mark.parametrize(
    ("game", "causes"),
    [
        ("Overfull", {"GK214": None, "GK802": "GK214", "GK813": "GK214"}),
        ("OverfullAndLate", {"GK214": None, "GK802": None, "GK813": None}),
        ("unpaid", {"GK107": None, "GK527": "GK107"}),
        ("ByAddress", {"GK608": None}),
        ("ByMemo", {}),
        ("Outlasting", {"GK402": "GK405", "GK405": None}),
        ("SetsNoRewards", {"GK107": None, "GK406": "GK107", "GK604": "GK107"}),
        ("SetsNoRewardsInTurn", {"GK107": None, "GK406": "GK107", "GK604": None}),
        ("SetsNoRewardsAndDraws", {"GK107": None, "GK601": "GK602", "GK602": None}),
        ("FilledOnce", {"GK103": None, "GK523": "GK103", "GK604": "GK103"}),
        ("BidsOfTheDead", {"GK522": None, "GK527": "GK522"}),
        ("OneRoster", {"GK102": None, "GK523": "GK102"}),
        ("LiveAgain", {"GK233": "GK505", "GK505": None}),
        ("LiveAgainByChance", {"GK233": "GK505", "GK505": None, "GK601": None}),
    ],
)
def test_cause_is_told_once(game: str, causes: dict[str, str | None]) -> None:
    """Its consequences name it; what fails by itself stays a cause."""
    select = tuple(causes) or ("GK608", "GK70")
    found = audit_here(f"{GAMES}:{game}", select=select, budget=1_000)
    named = {each.id: each.follows_from and each.follows_from.id for each in found.failed}
    assert named == causes


def test_copy_has_spaces_that_go_on_as_those_of_its_original() -> None:
    """In a process of its own, where spaces draw as they do for a user."""
    select = "GK601", "GK604", "GK638", "GK701"
    found = audit(f"{GAMES}:DrawsOfSpaces", select=select, budget=1_000)
    named = {each.id: each.follows_from and each.follows_from.id for each in found.failed}
    assert named == {"GK601": "GK638", "GK604": "GK638", "GK638": None, "GK701": "GK638"}


@pytest.mark.parametrize(
    ("game", "cause", "other"),
    [("NeedsSeed", "GK524", "GK609"), ("NeverTruncates", "GK107", "GK501")],
)
def test_what_another_check_tells_is_not_judged(game: str, cause: str, other: str) -> None:
    """Resets that raise draw nothing again, and half an end is none that is silent."""
    found = audit_here(f"{GAMES}:{game}", select=(cause, other), budget=1_000)
    assert [each.id for each in found.failed] == [cause]


def test_what_is_other_by_an_address_follows_from_the_address() -> None:
    """Objects numbered from the same number on at each reset: both episodes are one."""
    env, again = (ids_held(ByAddress)() for _ in range(2))
    kept = [object() for _ in range(5)]
    try:
        for each in (env, again):
            each.reset(seed=1)
            kept.append(object())
        assert env.agent_selection == again.agent_selection
        starts = set()
        for start in (0, 1):
            ids_from(env, start)
            ByAddress.reset(env)
            starts.add(env.agent_selection)
    finally:
        del linked_games.id  # type: ignore[attr-defined]  # which a hold has put there
    assert starts == {"player_0", "player_1"}


def test_number_beyond_a_bound_is_set_wherever_it_is_kept() -> None:
    """In dictionaries, lists and arrays of any depth; flags and the spaces' own bounds stay."""
    box = Box(0, 1, (2,), np.float32)
    kept: dict[str, Any] = {
        "a": [1.3, True, {"b": np.array([1.3, 0.2])}, (np.array([1.3], np.float32),)],
        "space": SimpleNamespace(contains=None, high=[1.3]),
        "own": SimpleNamespace(x=1.3, y=1),
    }
    env = SimpleNamespace(**kept)
    for container in list(containers_of(env)):
        set_in(container, np.float32(1.3), box.high[0])
    assert (env.a[0], env.a[1], env.own.x, env.own.y) == (1.0, True, 1.0, 1)
    np.testing.assert_array_equal([1.0, 0.2], env.a[2]["b"])
    assert env.a[3][0] == 1.0
    assert env.space.high == [1.3]


def test_whole_number_is_compared_as_it_is() -> None:
    """One that wraps around in the dtype of an observation is another number."""
    kept = [260, 4, 4.0, True, np.array([260, 4])]
    for container in (kept, kept[-1]):
        set_in(container, np.int8(4), np.int8(3))
    assert kept[:4] == [260, 3, 3.0, True]
    np.testing.assert_array_equal([260, 3], kept[4])


def test_parts_of_a_nested_observation_are_looked_at() -> None:
    """Each part beside its own space."""

    class Nested:
        agents = ("a",)
        level = 2.5

        def observation_space(self, agent: str) -> Any:
            return Dict(x=Tuple([Box(0, 1, (1,), np.float64), Box(0, 9, (1,), np.float64)]))

        def reset(self) -> Any:
            level = np.array([self.level])
            return {"a": {"x": (level, level)}}, {}

        def step(self, actions: Any) -> Any:
            return (*self.reset(), {})

        @property
        def unwrapped(self) -> Any:
            return self

    env = bounds_held(Nested)()
    env.level = 2.5
    env.reset()
    assert env.level == 1.0


def test_module_that_calls_something_else_id_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other modules of the environment's classes get numbers for objects."""
    monkeypatch.setattr(linked_games, "id", "tokens", raising=False)
    monkeypatch.setattr(tokens, "id", id, raising=False)
    ids_from(linked_games.ByAddress(), 0)
    assert linked_games.id == "tokens"
    assert tokens.id("new") == 0
