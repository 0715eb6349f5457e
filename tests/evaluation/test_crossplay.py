"""Cross-play: cells, best responses, fairness."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.evaluation.crossplay import _times
from gamekeeper.evaluation.estimates import Judge
from gamekeeper.evaluation.evaluation import Evaluation
from gamekeeper.evaluation.evaluator import evaluate
from gamekeeper.statistics.training_runs import luck_of_meetings, over_meetings
from tests.evaluation.policies import names


@pytest.fixture(name="line", scope="module")
def _line() -> Evaluation:
    """Who walks to the middle, who walks by chance, and who stays, on a longer line."""
    return evaluate(
        "two_robot_line",
        policies={"reference": "reference", "random": "random", "still": "noop"},
        episodes=50,
        env_kwargs={"n": 5, "horizon": 40},
        crossplay=True,
    )


@pytest.fixture(name="board", scope="module")
def _board() -> Evaluation:
    """A game with a winner and a loser."""
    return evaluate(
        "tictactoe",
        policies={"random": "random", "first": "first-legal"},
        episodes=50,
        crossplay=True,
    )


def cell(found: dict[str, Any], *positioned: str) -> dict[str, Any]:
    """The cell in which these policies sit, in the order of the positions."""
    return next(c for c in found["cells"] if tuple(c["roles"].values()) == positioned)


def test_crossplay_has_a_cell_for_every_policy_in_every_position(line: Evaluation) -> None:
    """Nine of them, each with its n, its interval, and each position's own return."""
    found = line.crossplay["two_robot_line"]
    assert found["roles"] == ["picker", "carrier"]
    assert len(found["cells"]) == 9
    still = cell(found, "still", "still")
    assert (still["kind"], still["mean"], still["n"]) == ("self", 0.0, 50)
    met = cell(found, "reference", "random")
    assert (met["kind"], met["unit"]) == ("fixed", "episode")
    assert (met["low"], met["high"]) == (None, None)  # they always meet: 2.0 each time
    mixed = cell(found, "random", "still")
    assert mixed["low"] <= mixed["mean"] <= mixed["high"]
    assert met["mean"] == pytest.approx(sum(met["by_role"].values()))


def test_crossplay_of_one_policy_is_what_it_does_alone(line: Evaluation) -> None:
    """The same episodes, not others."""
    found = line.crossplay["two_robot_line"]
    alone = next(
        row
        for row in line.results
        if (row["policy"], row["scope"], row["metric"]) == ("random", "team", "return")
    )
    assert alone["mean"]["value"] == cell(found, "random", "random")["mean"]


def test_crossplay_names_the_best_response_and_how_far_others_are(line: Evaluation) -> None:
    """To one who stays, it is whoever finds them; leads are of episodes it wasn't chosen on."""
    found = line.crossplay["two_robot_line"]["best_response"]
    row = next(r for r in found if r["role"] == "picker" and r["against"] == {"carrier": "still"})
    assert row["policy"] == "random"
    assert row["gap"]["still"]["value"] == row["value"]
    assert "first half" in row["note"]
    assert set(row["gap"]) == {"reference", "still"}


def test_crossplay_is_fair_both_ways_on_the_same_seeds(board: Evaluation) -> None:
    """Leads of the first position, and what is left of a difference once both have sat in it."""
    found = board.crossplay["tictactoe"]
    assert found["who"] == "player_1"
    both = next(r for r in found["fairness"] if set(r["policies"]) == {"random", "first"})
    a, b = both["policies"]
    there, back = cell(found, a, b), cell(found, b, a)
    lead = (there["mean"] * 2 + back["mean"] * 2) / 2  # the second has minus the first's
    assert both["first_mover"]["value"] == pytest.approx(lead)
    swapped = there["by_role"]["player_1"] - back["by_role"]["player_1"]
    assert both["difference"]["value"] == pytest.approx(swapped)
    assert both["means"][a] == pytest.approx(swapped / 2)


def test_comparisons_of_rivals_are_of_their_meetings(board: Evaluation) -> None:
    """Not of what each does against itself; both positions count alike."""
    (row,) = (each for each in board.comparisons if each["metric"] == "return")
    assert (row["scope"], row["who"]) == ("positions", "player_1 and player_2")
    both = next(
        r
        for r in board.crossplay["tictactoe"]["fairness"]
        if set(r["policies"]) == {"random", "first"}
    )
    sign = 1 if both["policies"][0] == row["a"] else -1
    assert row["difference"]["value"] == pytest.approx(sign * both["difference"]["value"])
    assert not [r for r in board.results if r["scope"] == "team" and r["metric"] == "return"]
    assert any("add up to 0 in every episode" in row["why"] for row in board.refused)


def test_comparisons_of_rivals_who_never_met_are_refused() -> None:
    """Strength against oneself is no strength."""
    found = evaluate("tictactoe", policies={"a": "random", "b": "first-legal"}, episodes=20)
    assert [row for row in found.comparisons if row["metric"] == "return"] == []
    assert any("cross-play lets two policies meet" in row["why"] for row in found.refused)


def test_crossplay_of_a_method_pairs_its_runs() -> None:
    """Runs are the unit of its cells; partners of the same method are zero-shot."""
    found = evaluate(
        "two_robot_line",
        policies={"method": names(10), "still": "noop"},
        episodes=10,
        env_kwargs={"n": 9, "horizon": 20},
        crossplay={"sample": 1},
    ).crossplay["two_robot_line"]
    by_kind = {c["kind"]: c for c in found["cells"] if set(c["roles"].values()) == {"method"}}
    assert tuple(by_kind["self"][k] for k in ("unit", "n", "pairings")) == ("run", 10, 10)
    zero = by_kind["zero-shot"]
    assert tuple(zero[k] for k in ("unit", "n", "pairings")) == ("run", 10, 20)
    assert zero["low"] <= zero["mean"] <= zero["high"]
    fixed = cell(found, "method", "still")
    assert tuple(fixed[k] for k in ("kind", "n", "pairings")) == ("fixed", 10, 10)


@pytest.mark.parametrize(("luck", "spread"), [(0.0, 1.0), (0.5, 0.0), (2.0, 1.0)])
def test_interval_over_meetings_of_runs_covers_new_seeds(luck: float, spread: float) -> None:
    """Of all meetings within a method, from the fewest runs on; simulated with shared seeds."""
    rng, hits, rounds, runs = np.random.default_rng(7), 0, 400, 10
    others = ~np.eye(runs, dtype=bool)
    for _ in range(rounds):
        sits, deal = rng.standard_normal((2, runs)), luck * rng.standard_normal(30)
        scores = sits[0][:, None, None] + sits[1][:, None] + deal
        scores = scores + spread * rng.standard_normal((runs, runs, 30))
        own = [
            (scores[k][others[k]].mean(axis=0) + scores[:, k][others[k]].mean(axis=0)) / 2
            for k in range(runs)
        ]
        times = _times(runs, None, "zero-shot")
        found = Judge(0.95, 0).meetings([np.stack(own)], times=times, of="")
        assert found is not None
        hits += found["low"] <= 0.0 <= found["high"]
    assert 0.92 <= hits / rounds <= 0.98


def test_luck_of_meetings_is_what_two_runs_do_not_add_up_to() -> None:
    """It counts once: both runs' means hold it, and an interval that adds these is too wide."""
    rng, pairs = np.random.default_rng(3), list(np.ndindex(12, 12))
    own = rng.standard_normal((2, 12))
    added = (own[0][:, None] + own[1]).ravel()
    none, some = (luck_of_meetings(pairs, added + x * rng.standard_normal(144)) for x in (0, 1))
    assert none is not None
    assert some is not None
    assert none.variance == pytest.approx(0.0, abs=1e-20)
    assert some.variance == pytest.approx(1 / 144, rel=0.4)
    assert (some.freedom, luck_of_meetings(pairs[:20], added[:20])) == (121, None)
    noise = rng.standard_normal((12, 12, 30))
    blocks = [noise.mean(axis=1), noise.mean(axis=0)]
    luck = luck_of_meetings(pairs, noise.mean(axis=2).ravel())
    wide, fair = over_meetings(blocks), over_meetings(blocks, luck=luck)
    assert fair.high - fair.low < 0.9 * (wide.high - wide.low)
