"""The structure as it is measured: every field of the document, for both APIs."""

from functools import partial
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.measured_form import PROBES, measured
from gamekeeper.checks.endings.role_symmetry import exchangeable, fares
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.rounds import kind_of_order
from gamekeeper.contract import Contract
from gamekeeper.reporting.measured_text import words
from tests.auditing.small_games import Grab
from tests.faults.lifecycle import ResetIgnored
from tests.faults.ticks import Hands, HiddenHands
from tests.faults.tokens import Tokens

FIELDS = {
    "stages",
    "order",
    "observe",
    "conflicts",
    "legality",
    "messages",
    "order_sensitive",
    "order_ticks",
    "deterministic",
    "horizon",
    "near_limits",
    "symmetric",
    "reward",
    "endings",
    "may_join",
    "may_leave",
    "influence",
    "looked_ahead",
    "advice",
    "because",
    "why",
    "errors",
    "not_measured",
}


def form_of(spec: Any, monkeypatch: pytest.MonkeyPatch, budget: int = 600) -> dict[str, Any]:
    """What is measured, with only the probes that it needs."""
    from gamekeeper.auditing import audit as module

    monkeypatch.setattr(module, "selected", lambda select, ignore: {})
    return dict(audit_here(spec, budget=budget).measured)


def test_measured_of_nothing_has_every_field() -> None:
    """What couldn't be measured is None, and no field is missing."""
    found = measured(Contract(), ProbeEvidence(api="aec"))
    assert set(found) == FIELDS
    assert (found["advice"], found["order"], found["deterministic"]) == (None, None, None)
    assert found["why"]
    nulls = {key for key, value in found.items() if value is None} - {"may_join", "may_leave"}
    assert nulls - {"order_sensitive", "order_ticks", "looked_ahead"} == set(found["not_measured"])


def test_measured_names_its_probes() -> None:
    """The audit gathers what the measurement reads."""
    assert set(PROBES) == {"rollout", "order", "form", "same_seed"}


def test_used_instance_that_differs_says_nothing_of_seeds() -> None:
    """Fresh instances give the same episode again, so that no contract is to declare otherwise."""
    found = audit_here(ResetIgnored, budget=500)
    assert found.of("GK606").outcome == "failed"
    assert found.measured["deterministic"] is None


def test_measured_parallel_game(monkeypatch: pytest.MonkeyPatch) -> None:
    """A game whose dictionary's order decides is told so, and better played in turns."""
    found = form_of(partial(Grab, "first"), monkeypatch)
    assert set(found) == FIELDS
    assert found["order_sensitive"] == "outcome"
    assert found["deterministic"] is True
    assert found["horizon"] == 8
    assert found["advice"] == "aec"
    assert found["order"] == "none"
    assert found["endings"]["by_agent"]["0"]["truncated"] == found["endings"]["episodes"]


def test_measured_parallel_advice_names_its_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no order changes anything Parallel is right, in so many ticks."""
    found = form_of(partial(Grab, "draw"), monkeypatch)
    assert (found["order_sensitive"], found["advice"]) == ("none", "parallel")
    assert "comparisons" in found["why"]


def test_measured_aec_that_hides_moves_is_parallel(monkeypatch: pytest.MonkeyPatch) -> None:
    """In turns, but nobody sees the tick's moves: a simultaneous game."""
    found = form_of(HiddenHands, monkeypatch, 3_000)
    assert found["advice"] == "parallel", found["why"]
    assert (found["order"], found["observe"], found["conflicts"]) == (
        "none",
        "after tick",
        "joint rule",
    )
    assert found["horizon"] == 12


def test_measured_aec_that_shows_moves_is_aec(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who comes later sees what was done: a game in turns, with the share and its interval."""
    found = form_of(Hands, monkeypatch, 900)
    assert found["advice"] == "aec"
    assert "interval" in found["why"]


def test_measured_influence_has_intervals(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every share lies in its interval, with the number of looks beside it."""
    rows = form_of(partial(Grab, "none"), monkeypatch)["influence"]
    assert rows != []
    for row in rows:
        assert {"from", "to", "on", "lag", "p", "low", "high", "n"} == set(row)
        assert 0 <= row["low"] <= row["p"] <= row["high"] <= 1
        assert row["n"] > 0
    assert any(row["on"] == "reward" and row["lag"] == 0 and row["p"] > 0 for row in rows)


def test_measured_zero_sum(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board game's payments cancel out, and its agents don't share them."""
    reward = form_of(Tokens, monkeypatch)["reward"]
    assert (reward["zero_sum"], reward["shared"]) == (True, False)


class TwiceOver(Grab):
    """Its agents are terminated and truncated at once."""

    def step(self, actions: Any) -> Any:
        """Raises both flags."""
        observations, rewards, _, truncations, infos = super().step(actions)
        return observations, rewards, dict(truncations), truncations, infos


def test_both_flags_of_an_end_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """An agent that is terminated and truncated at once counts as both, and it is said."""
    endings = form_of(partial(TwiceOver, "draw"), monkeypatch, 60)["endings"]
    count = endings["episodes"]
    assert endings["both"] == count
    assert endings["by_agent"]["0"] == {"terminated": count, "truncated": count, "open": 0}
    assert f"{count} of them terminated and truncated at once" in words(endings)


@pytest.mark.parametrize(
    ("kind", "rounds"),
    [
        ("fixed", ["abc", "abc", "ac"]),
        ("rotating", ["abc", "bca", "cab", "abc"]),
        ("other", ["abc", "bac", "abc"]),
        ("other", ["abc", "bca", "bca"]),
        (None, ["a", "b"]),
        (None, []),
    ],
)
def test_kind_of_order_is_told(kind: str | None, rounds: list[str]) -> None:
    """Fixed, rotating by one, anything else, or nothing to tell."""
    assert kind == kind_of_order([tuple(each) for each in rounds])


def test_exchangeable_tells_a_favoured_agent() -> None:
    """One agent that always gets more isn't interchangeable; equal chances are."""
    rng = np.random.default_rng(0)
    fair = rng.normal(size=(12, 3, 2))
    unfair = fair.copy()
    unfair[:, 1, 0] += 3.0
    assert exchangeable(fair) > 0.01
    assert exchangeable(unfair) <= 0.001
    assert exchangeable(np.zeros((12, 3, 2))) is None


def test_exchangeable_passes_over_the_order_of_sums() -> None:
    """Returns that differ in their last digits alone, and always the same way, are equal."""
    rng = np.random.default_rng(5)
    rows = np.repeat(rng.normal(1e9, 1e3, size=(12, 1, 1)), 3, axis=1)
    rows[:, 1] += 1e-6
    assert exchangeable(rows) is None


def test_exchangeable_leaves_out_who_joined_later() -> None:
    """A spare that had less time isn't held against its role; a favoured starter still is."""
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(12, 4, 2))
    rows[:, 3] -= 5.0
    there = np.tile([True, True, True, False], (12, 1))
    assert exchangeable(rows) <= 0.01
    assert exchangeable(rows, there) > 0.01
    rows[:, 0, 0] += 4.0
    assert exchangeable(rows, there) <= 0.01


def test_exchangeable_keeps_its_level() -> None:
    """Agents that differ by chance alone are told apart in about one of a hundred trials."""
    rng = np.random.default_rng(2)
    alarms = 0
    for trial in range(300):
        rows = rng.standard_cauchy(size=(8, 3, 2))
        there = rng.random((8, 3)) < 0.8
        alarms += exchangeable(rows, there, seed=trial, rounds=199) <= 0.01
    assert alarms <= 8  # binomial: 8 or more in 300 at 1 % has a chance below 0.02


def test_episodes_that_are_cut_off_count_by_whole_rounds() -> None:
    """Who sits before the place where an episode was stopped hasn't fared differently."""
    played = gk.rollout(HiddenHands, episodes=8, seed=0, most_turns=20)
    agents = ["player_0", "player_1", "player_2"]
    rows = np.array([fares(episode, agents) for episode in played.episodes])
    assert rows[:, :, 1].tolist() == [[6.0, 6.0, 6.0]] * 8
