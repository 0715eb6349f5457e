"""Environments of another form than the API's: what else is wrong with them is found too."""

import pickle
from typing import Any

import pytest

from gamekeeper.auditing import gather
from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.readings import RETURNS, SPACES, readings_of, through
from gamekeeper.interface.opening import open_env
from tests.auditing import older_games
from tests.auditing.older_games import NamedSpaces, NothingTold, Older, OlderTimed, WithoutInfos
from tests.auditing.roster_games import Counting, Turning
from tests.faults.rovers import Rovers

HERE = "tests.auditing.older_games:"
FORM = {"KeptSpaces": "GK201", "NamedSpaces": "GK201"}
"""The check that tells of a game's form, where it isn't GK110."""
READ = ["Older", "OlderTogether", "WithoutInfos", "KeptSpaces", "NamedSpaces"]


@pytest.mark.parametrize("name", READ)
def test_form_is_all_that_is_wrong(name: str) -> None:
    """A game that is sound but for its form is accused of that alone, and seen to its end."""
    found = audit_here(getattr(older_games, name), budget=2_000)
    high = {each.id for each in found.failed if each.severity != "low"}
    assert high == {FORM.get(name, "GK110")}
    seen = {each.id for each in found.verdicts if each.outcome == "passed"}
    assert {"GK601", "GK213", "GK401", "GK901"} <= seen


@pytest.mark.parametrize(("name", "id"), [("OlderByLot", "GK602"), ("KeptByLot", "GK214")], ids=str)
def test_second_fault_is_told_by_a_program_that_runs(name: str, id: str) -> None:
    """Its program reads the environment as the audit did, and fails by that fault alone."""
    verdict = audit_here(HERE + name, select=("GK110", "GK201", id), budget=600).of(id)
    assert verdict.outcome == "failed"
    assert verdict.reproduced is not None
    assert verdict.reproduced.failed == verdict.reproduced.tried
    reading = RETURNS if name.startswith("Older") else SPACES
    assert f"make = {reading.function.__name__}(" in verdict.findings[0].reproducer


@pytest.mark.parametrize("game", [Older, WithoutInfos, OlderTimed])
def test_entries_that_a_reading_adds_are_no_evidence(game: Any) -> None:
    """What a call returns in another form passes no check of its entries, and fails none.

    One flag is neither a termination nor a truncation, whatever ends an episode.
    """
    select = ("GK107", "GK108", "GK109", "GK501", "GK502", "GK508")
    found = audit_here(game, select=select, budget=300)
    assert {each.outcome for each in found.verdicts} == {"not_exercised"}


def test_infos_that_are_none_are_told_once() -> None:
    """None in place of the infos of a reset has another form: no agent's entry is missing."""

    class NoInfos(Counting):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            return super().reset(seed, options)[0], None

    found = audit_here(NoInfos, select=("GK10", "GK11"), budget=300)
    assert {each.id for each in found.failed} == {"GK110"}


@pytest.mark.parametrize("game", [Counting, Turning, Rovers])
def test_sound_environment_is_played_as_it_is(game: Any, monkeypatch: Any) -> None:
    """No reading is even tried where a reset and a step show something, nor would one be taken."""

    def refuse(*args: Any) -> Any:
        raise AssertionError("a reading was asked for")

    assert readings_of(open_env(game), 1) == ()
    monkeypatch.setattr(gather, "readings_of", refuse)
    assert audit_here(game, select=("GK1", "GK2"), budget=300).failed == ()


def test_nothing_is_read_where_nothing_is_returned() -> None:
    """A step without a value can't be read, whatever its reset returns."""
    found = audit_here(NothingTold, select=("GK110", "GK311", "GK601", "GK901"), budget=300)
    outcomes = {verdict.id: verdict.outcome for verdict in found.verdicts}
    assert outcomes.pop("GK110") == "failed"
    assert set(outcomes.values()) <= {"not_exercised", "not_applicable"}


def test_read_environment_is_one_still() -> None:
    """It can be pickled, and is called by the name of its class."""
    env = through(NamedSpaces, (SPACES,))()
    assert type(env).__name__ == "NamedSpaces"
    assert isinstance(env, NamedSpaces)
    again = pickle.loads(pickle.dumps(env))
    assert again.action_space("a") == env.action_spaces["a"]
