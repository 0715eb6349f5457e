from pathlib import Path

import pytest

from gamekeeper.contract import Contract
from gamekeeper.episodes.divergence import Divergence
from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.reporting.results_text import divergence_text
from gamekeeper.runs.comparison import diff, different_set_ups
from gamekeeper.runs.recording import rollout
from tests.runs.plays import played
from tests.runs.walks import Walk


def test_diff_of_equal_runs_is_none(tmp_path: Path) -> None:
    """Two recordings of one seed don't differ, nor does evidence in memory from one of them."""
    one = played(tmp_path, out="one")
    two = played(tmp_path, out="two")

    assert one.fingerprint == two.fingerprint
    assert diff(tmp_path / "one", tmp_path / "two") is None


def test_diff_refuses_another_level(tmp_path: Path) -> None:
    """Digests cover the same rows as values, and yet nothing is compared across levels."""
    one = played(tmp_path, out="one")
    digests = played(tmp_path, out="three", level="digest")

    assert one.fingerprint.removeprefix("full:") == digests.fingerprint.removeprefix("digest:")
    with pytest.raises(EvidenceError, match="different levels"):
        diff(one, tmp_path / "three")


def test_diff_names_the_first_field(tmp_path: Path) -> None:
    """A reward that differs is found, from either side, and at the level of digests."""
    edit = ("float(actions.get(agent, 0))", "float(self.turn == 3)")
    for level in ("full", "digest", "actions"):
        one = played(tmp_path, out=f"{level} one", policies="first-legal", level=level)
        two = played(tmp_path, edit, out=f"{level} two", policies="first-legal", level=level)
        for found, values in ((diff(one, two), (0.0, 1.0)), (diff(two, one), (1.0, 0.0))):
            assert found is not None
            assert (found.episode, found.turn, found.agent, found.field) == (0, 2, "a", "reward")
            assert values == (found.recorded, found.replayed)


def test_diff_sees_infos_that_alone_differ(tmp_path: Path) -> None:
    """The fingerprint doesn't cover infos; a difference of two runs does."""
    one = played(tmp_path, out="one")
    two = played(tmp_path, ('{"turn": self.turn}', '{"turn": -self.turn}'), out="two")

    assert one.fingerprint == two.fingerprint
    found = diff(one, two)
    assert found is not None
    assert (found.episode, found.turn, found.agent, found.field) == (0, 1, "a", "info")


def test_diff_leaves_volatile_infos_out(tmp_path: Path) -> None:
    """What one of the contracts declares volatile may differ."""
    contract = Contract.from_json({"infos": {"turn": {"volatile": True}}})
    one = played(tmp_path, out="one", contract=contract)
    two = played(tmp_path, ('{"turn": self.turn}', '{"turn": -self.turn}'), out="two")

    assert diff(one, two) is None
    assert diff(two, one) is None


@pytest.mark.parametrize(
    ("options", "field", "values"),
    [
        ({"seed": 1}, "seed", None),
        ({"options": {"start": 2}}, "options", (None, '{"start":2}')),
        ({"episodes": 3}, "episode", ("missing", "present")),
        ({"env_kwargs": {"turns": 5}}, "environment.kwargs", ({}, {"turns": 5})),
    ],
)
def test_diff_names_what_runs_were_told(
    tmp_path: Path, options: dict[str, object], field: str, values: tuple[object, object] | None
) -> None:
    """Seeds, options, the number of episodes and arguments differ by name."""
    found = diff(played(tmp_path, out="one"), played(tmp_path, out="two", **options))

    assert found is not None
    assert field == found.field
    assert values is None or values == (found.recorded, found.replayed)


def test_diff_says_the_set_up_before_any_turn(tmp_path: Path) -> None:
    """A later episode's seed and the arguments are told before turns of an earlier episode."""
    edit = ("float(actions.get(agent, 0))", "float(self.turn == 3)")
    one = played(tmp_path, out="one", policies="first-legal")
    two = played(tmp_path, edit, out="two", policies="first-legal", env_kwargs={"turns": 5}, seed=1)
    found = different_set_ups(one, two)

    assert [each.field for each in found] == ["environment.kwargs", "seed"]
    assert diff(one, two) == found[0]
    assert str(found[0]).startswith("the arguments of the environment\n")
    assert str(found[1]).startswith("episode 0, the seed of its reset\n")


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((["a"], None), "the number of turns (only one side has this one)"),
        ((["a"], ["a", "b"]), "the number of rows of this turn (a row for each agent in it)"),
        ((["a"], ["b"]), "the agents of this turn"),
        ((["a"], ["a"]), "the spelling of values that are equal"),
    ],
)
def test_rows_that_differ_are_explained(values: tuple[object, object], text: str) -> None:
    """The field `rows` says in words what differs: turns, rows of a turn, or their agents."""
    found = Divergence(0, 3, None, "rows", *values)

    assert text == found.field_text
    assert f"episode 0, turn 3, {text}" in str(found)
    assert f"episode 0, turn 3: {text}" in divergence_text(found, width=100)
    assert found.to_json()["field"] == "rows"


def test_diff_passes_over_what_is_within_tolerance(tmp_path: Path) -> None:
    """Numbers within the tolerance count as equal."""
    noise = ("self.rng.normal(size=3) for", "self.rng.normal(size=3) + 1e-9 for")
    one, two = played(tmp_path, out="one"), played(tmp_path, noise, out="two")

    assert diff(one, two, tolerance=1e-6) is None
    found = diff(one, two)
    assert found is not None
    assert found.field == "obs"


def test_diff_needs_runs(tmp_path: Path) -> None:
    """A folder without a run is refused with its path."""
    with pytest.raises(RunError, match="there is no run"):
        diff(tmp_path, rollout(Walk(), episodes=1))
