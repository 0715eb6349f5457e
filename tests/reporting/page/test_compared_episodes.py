"""Two episodes have one first difference, and their agents one order."""

import base64
from pathlib import Path

import numpy as np

from gamekeeper.episodes.divergence import compare
from gamekeeper.reporting.page.composition import pairs_of, shown
from gamekeeper.reporting.page.episode_list import packed_of
from tests.reporting.page.games import recorded


def test_pair_tells_the_first_divergence_as_it_was_compared(tmp_path: Path) -> None:
    """Its text, its data for the script and the checksums of its turns name the same turn."""
    one = recorded(tmp_path / "one", policies="random")
    two = recorded(tmp_path / "two", policies="first-legal")
    runs = [
        shown(evidence, key=key, path=key, name=key) for key, evidence in (("a", one), ("b", two))
    ]
    pairs = pairs_of(*runs, text="two runs", most=3)
    assert len(pairs) == 3
    for pair in pairs:
        number = pair.left[1]
        found = compare(one.episode(number), two.episode(number)).divergence
        assert found is not None
        told = pair.to_json()["divergence"]
        assert (told["turn"], told["agent"], told["field"]) == (
            found.turn,
            found.agent,
            found.field,
        )
        assert pair.text.endswith(f"first difference at turn {found.turn}")
        sums = [
            np.frombuffer(base64.b64decode(packed_of(evidence, number)["checksums"]), "<u4")
            for evidence in (one, two)
        ]
        shorter = min(map(len, sums))
        differ = np.flatnonzero(sums[0][:shorter] != sums[1][:shorter])
        assert differ[0] == found.turn


def test_checksums_of_equal_episodes_are_equal() -> None:
    """Played again from its seed, an episode has the same checksums, one a turn."""
    one, two = (packed_of(recorded(episodes=1, seed=3), 0) for _ in range(2))
    assert one["checksums"] == two["checksums"]
    assert len(base64.b64decode(one["checksums"])) == 4 * (one["turns"] + 1)


def test_run_names_its_agents_in_their_own_order() -> None:
    """By the possible agents, whoever acted first: an agent's place is its colour."""
    evidence = recorded(agents=("b_0", "a_0"), episodes=1)
    card = shown(evidence, key="a", path="run", name="run").card
    assert card.agents == (("b_0", "b"), ("a_0", "a"))
