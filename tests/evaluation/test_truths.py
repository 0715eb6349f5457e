"""Evaluation of a game whose truth is known: rivals, families of claims, what broke off, resets."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.evaluation.estimates import Judge
from gamekeeper.evaluation.evaluation import Evaluation
from gamekeeper.evaluation.evaluator import evaluate
from tests.evaluation.duel import Duel, Rock, Strength


def played(
    policies: dict[str, Any], *, episodes: int = 100, crossplay: Any = None, **told: Any
) -> Evaluation:
    """An evaluation of the duel; `failed_return` is the environment's in the specification."""
    failed = {"failed_return": told.pop("failed_return")} if "failed_return" in told else {}
    environment = {"spec": lambda: Duel(**told), **failed}
    spec = {"environments": {"duel": environment}, "policies": policies}
    return evaluate(spec, episodes=episodes, crossplay=crossplay)


def primary(found: Evaluation) -> list[Any]:
    """Comparisons that claims are made of."""
    return [row for row in found.comparisons if row["family"] == "primary"]


TWO = {"weak": Strength(50), "strong": Strength(70)}


def test_rivals_are_known_by_a_constant_sum_and_compared_in_both_positions() -> None:
    """Win 1, lose 0: no team; the stronger is found, and who goes first gains nothing by it."""
    found = played(TWO, episodes=100, crossplay=True)
    (row,) = primary(found)
    assert (row["scope"], row["unit"], row["n"]) == ("positions", "episode", 100)
    assert row["difference"]["high"] < 0
    assert "weak is below strong" in row["claim"]
    assert not [r for r in found.results if r["scope"] == "team" and r["metric"] == "return"]
    assert any("add up to 1 in every episode" in each["why"] for each in found.refused)
    crossed = found.crossplay["duel"]
    assert {each["policy"] for each in crossed["best_response"]} == {"strong"}
    assert len(crossed["fairness"]) == 3


def test_a_team_whose_returns_vary_is_a_team() -> None:
    """Sums that differ tell a team; so do equal returns, whose sum is constant, too."""
    assert primary(played(TWO, is_team=True))[0]["scope"] == "team"
    steady = evaluate("two_robot_line", policies={"a": "reference", "b": "noop"}, episodes=12)
    assert [row for row in steady.results if (row["scope"], row["metric"]) == ("team", "return")]


def test_methods_that_are_rivals_are_compared_in_both_positions() -> None:
    """Runs are the unit, and they meet on the same seeds."""
    policies = {
        "low": [Strength(50 + k) for k in range(10)],
        "high": [Strength(65 + k) for k in range(10)],
    }
    (row,) = primary(played(policies, episodes=12, crossplay={"sample": 1}))
    assert (row["unit"], row["n"], row["episodes"]) == ("run", 10, 12)
    assert row["difference"]["high"] < 0
    assert "10 training runs on 12 seeds" in row["claim"]


def test_rivals_that_did_not_meet_are_told_why() -> None:
    """Cross-play that is on isn't advised."""
    found = played({**TWO, "third": Strength(60)}, crossplay={"partners": ["third"]}, episodes=10)
    (why,) = (each["why"] for each in found.refused if "weak and strong" in each["what"])
    assert "partners" in why


def test_what_says_the_same_twice_is_compared_once() -> None:
    """The team, the role and the agent of an environment of one agent are one row."""
    found = played({"a": Strength(50), "b": Strength(51)}, agents=1, is_team=True)
    assert [row["scope"] for row in found.comparisons] == ["team"]


def test_claims_are_of_the_primary_family() -> None:
    """Roles and agents stand in the tables, corrected for the number of all."""
    found = played(TWO, is_team=True)
    assert len(found.claims) == len(primary(found)) == 1
    rest = [row for row in found.comparisons if row["family"] == "secondary"]
    assert {row["scope"] for row in rest} <= {"role", "agent"}
    assert rest
    assert all(row["difference"]["tests"] == len(found.comparisons) for row in rest)


def test_many_comparisons_leave_plain_differences_plain() -> None:
    """Fourteen policies far apart: 91 pairs, all claimed, by p-values that have no floor."""
    found = played({f"q{k}": Strength(5 * k) for k in range(14)}, is_team=True)
    assert len(found.claims) == 91
    assert all("is below" in claim for claim in found.claims)


def test_an_interval_without_0_that_is_no_claim_is_explained() -> None:
    """Alone it would be one; corrected it isn't, and the sentence says so."""
    rng = np.random.default_rng(1)
    policies = {f"q{k}": Strength(50) for k in range(3)}
    found = played(policies, is_team=True, is_seeded=False)
    row = dict(primary(found)[0])
    row["difference"] = {**row["difference"], "low": 0.1, "high": 0.9, "p": 0.2, "p_alone": 0.03}
    from gamekeeper.evaluation.comparisons import claim_of
    from gamekeeper.evaluation.spec import Spec

    del rng
    said = claim_of(Spec(), row)
    assert "isn't shown to differ" in said
    assert "alone 0.03; the interval is that of one comparison" in said


def test_few_episodes_that_broke_off_are_counted_in_row_and_claim() -> None:
    """Of a hundred, two or three; the sentence has both numbers."""
    (row,) = primary(played(TWO, is_team=True, crash=0.04, episodes=100))
    assert 0 < row["broken"] <= 5
    assert row["episodes"] == row["n"] == 100 - row["broken"]
    assert row["of_episodes"] == 100
    assert f"{row['broken']} of 100 episodes broke off" in row["claim"]


def test_many_episodes_that_broke_off_are_no_sample() -> None:
    """No interval over the survivors; a declared return of failures makes one."""
    found = played(TWO, is_team=True, crash=0.3)
    (row,) = primary(found)
    assert row["difference"]["low"] is None
    assert any("no sample of all" in each["why"] for each in found.refused)
    (row,) = primary(played(TWO, is_team=True, crash=0.3, failed_return=0.0))
    assert (row["n"], row["broken"]) == (100, 0)
    assert row["difference"]["low"] is not None


def test_a_run_that_always_breaks_off_is_named() -> None:
    """The comparison stays, without a figure and with the reason."""

    class Dead(Strength):
        def __call__(self, *told: Any) -> Any:
            raise RuntimeError("no idea")

    found = played({"good": Strength(50), "dead": Dead(1)}, is_team=True, episodes=10)
    (row,) = primary(found)
    assert row["difference"] is None
    assert "10 of 10 episodes broke off" in row["claim"]
    assert any("No claim" in note and "broke off" in note for note in found.notes)


def test_a_reward_that_is_not_finite_breaks_its_episode_off() -> None:
    """It is named; the agent isn't 0 in the team's sum."""
    found = played({"a": Strength(50)}, is_team=True, bad=0.2)
    (note,) = (note for note in found.notes if note.startswith("Failed"))
    assert "a in duel" in note
    assert "'p1' add up to nan" in note
    (team,) = (r for r in found.results if (r["scope"], r["metric"]) == ("team", "return"))
    assert team["episodes"] + team["broken"] == 100
    assert team["mean"]["value"] > 95  # the sum of two, in every episode that counts


@pytest.mark.parametrize("is_seeded", [True, False])
def test_resets_are_compared_before_they_are_said_to_be_the_same(is_seeded: bool) -> None:
    """An environment that ignores its seed begins differently for every policy."""
    found = played(TWO, is_team=True, is_seeded=is_seeded)
    notes = " ".join(found.notes)
    assert ("first observations were the same" in notes) == is_seeded
    assert ("don't follow their seed" in notes) == (not is_seeded)
    assert ("paired episodes" in found.claims[0]) == is_seeded


def test_medians_have_intervals_and_notes_say_how_many_runs() -> None:
    """Ten runs suffice for a median and a difference, not for a mean."""
    found = played({"m": [Strength(50 + k) for k in range(10)]}, is_team=True, episodes=20)
    (row,) = (
        r for r in found.results if (r["scope"], r["metric"], r["run"]) == ("team", "return", None)
    )
    assert row["median"]["low"] < row["median"]["value"] < row["median"]["high"]
    (note,) = (note for note in found.notes if note.startswith("m has 10"))
    assert "30 for the mean, 12 for the interquartile mean" in note
    assert "median" not in note


def test_equal_figures_have_no_interval_whatever_their_unit() -> None:
    """0, 1 and 10 alike."""
    for value in (0.0, 1.0, 10.0):
        found = Judge(0.95, 0).episodes(np.full(50, value), "mean", of="a", name=["a"])
        assert found is not None
        assert (found["value"], found["low"]) == (value, None)


def test_a_cycle_has_no_ranking() -> None:
    """Rock, script, scissors: the cycle is named, with its alpha-rank, and the matrix is there."""
    hands = {"rock": Strength(0), "script": Strength(1), "scissors": Strength(2)}
    spec = {"environments": {"rps": {"spec": Rock}}, "policies": hands}
    found = evaluate(spec, episodes=100, crossplay=True)
    ranking = found.crossplay["rps"]["ranking"]
    assert sorted(ranking["cycle"]) == sorted(hands)
    assert ranking["alpha_rank"]["rock"] == pytest.approx(1 / 3)
    assert any("rps has no ranking" in note for note in found.notes)
    payoffs = found.crossplay["rps"]["payoffs"]
    assert (payoffs["rows"], payoffs["policies"]) == ("p0", list(hands))
    assert payoffs["means"][1][0] > payoffs["means"][0][1]
