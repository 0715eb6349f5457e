"""The pure parts of an attribution, and who plays on which side."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gamekeeper.diagnosis.attribution.agent_measures import (
    Measured,
    harms,
    influence,
    laziness,
    measured,
    penalties,
    shapley_exact,
)
from gamekeeper.diagnosis.attribution.message_influence import binned, dependence, information
from gamekeeper.diagnosis.attribution.replacement_runs import Sides


def _part(value, half=0.5):
    return Measured(value, value - half, value + half, 0.01, 50, "noop")


def _lazy(shares, losses=None, *, whom="a", baseline="noop"):
    names = list("abcdef"[: len(shares)])
    shapley = {name: _part(value) for name, value in zip(names, shares, strict=True)}
    lost = {name: _part(x) for name, x in zip(names, losses or shares, strict=True)}
    return laziness(whom, names, lost, shapley, baseline=baseline).is_lazy


def test_agent_that_brings_nothing_is_lazy() -> None:
    """Its peers bring 6 each, it brings nothing."""
    assert _lazy([0.0, 6.0, 6.0]) is True


def test_agent_that_brings_its_share_is_not_lazy() -> None:
    """Nor are its peers."""
    assert [_lazy([4.0, 4.0, 4.0], whom=name) for name in "abc"] == [False] * 3


def test_agent_of_a_team_with_hands_to_spare_is_not_lazy() -> None:
    """Nothing is lost without any single one, though each brings its share."""
    assert _lazy([4.0, 4.0, 4.0], [0.0, 0.0, 0.0]) is False


def test_agent_that_the_team_would_miss_is_not_lazy() -> None:
    """A small share but a large loss: it does what nobody else would do in its place."""
    assert _lazy([0.0, 6.0, 6.0], [8.0, 8.0, 8.0]) is False


def test_agent_is_not_lazy_where_the_interval_allows_half_a_share() -> None:
    """Below a fair share, but perhaps not by much."""
    assert _lazy([2.0, 4.0, 4.0]) is False


def test_laziness_is_not_told_of_a_single_agent_or_against_random() -> None:
    """There is nobody to compare with, or nobody who did nothing."""
    assert _lazy([0.0]) is None
    assert _lazy([0.0, 6.0], baseline="random") is None


def test_agent_without_which_the_team_has_more_is_harmful() -> None:
    """Both figures are surely negative; one that brings nothing, or little, is not."""
    figures = {"a": _part(-16.5), "b": _part(4.0), "c": _part(0.0)}
    found = harms(figures, figures)
    assert [found[name].is_harmful for name in "abc"] == [True, False, False]
    assert "16.5 more where it does nothing" in found["a"].why
    assert harms(figures, {**figures, "a": _part(1.0)})["a"].is_harmful is False
    beside = {name: replace(each, baseline="random") for name, each in figures.items()}
    told = harms(beside, beside)["a"]
    assert told.is_harmful is None
    assert told.why.endswith("that may be harm, or doing too little")
    few = {"a": Measured(-16.5, None, None, None, 9, "noop")}
    assert harms(few, few)["a"].is_harmful is None


def _team(rng, *, skills):
    """The lazy ones of a noisy team whose gains lessen with the hands that are at work."""
    power, noise = rng.uniform(0.3, 1.2), rng.uniform(0.5, 3)
    luck, values = rng.normal(1, 0.3, 50).clip(0), np.zeros((8, 50))
    for mask in range(1, 8):
        work = sum(skills[k] for k in range(3) if mask >> k & 1)
        if work:
            values[mask] = 10 * luck * work**power + rng.normal(0, noise, 50)
    shapley, lost = {}, {}
    for k, name in enumerate("abc"):
        brought = shapley_exact(values)[k]
        shapley[name] = measured(brought, baseline="noop", rng=rng)
        lost[name] = measured(values[7] - values[7 & ~(1 << k)], baseline="noop", rng=rng)
    return [
        name
        for name in "abc"
        if laziness(name, list("abc"), lost, shapley, baseline="noop").is_lazy
    ]


def test_laziness_is_found_and_not_made_up() -> None:
    """Of thirty teams whose first stands still it is named; in thirty fair ones hardly anybody."""
    rng = np.random.default_rng(0)
    skills = rng.uniform(0.7, 1.3, (30, 3))
    fair = [_team(rng, skills=row) for row in skills]
    lazy = [_team(rng, skills=[0.0, *row[1:]]) for row in skills]
    assert sum(map(bool, fair)) <= 1
    assert sum(each == ["a"] for each in lazy) >= 28


def test_measured_has_an_interval_from_fifty_episodes_on() -> None:
    """Below that a mean stands alone; of nothing there is no mean."""
    rng = np.random.default_rng(0)
    few, many = (measured(rng.normal(1, 1, n), baseline="noop", rng=rng) for n in (49, 50))
    assert few is not None
    assert many is not None
    assert (few.low, few.n) == (None, 49)
    assert many.low is not None
    assert many.high is not None
    assert many.low < many.value < many.high
    assert measured(np.empty(0), baseline="noop", rng=rng) is None


def test_measured_of_nothing_but_zeros_is_unsure_by_its_unit() -> None:
    """A rare loss of one unit could have been missed, of a smaller one less."""
    rng = np.random.default_rng(0)
    one, two = (measured(np.zeros(50), baseline="noop", rng=rng, unit=unit) for unit in (1.0, 10.0))
    assert one is not None
    assert two is not None
    assert one.high == pytest.approx(0.0714, abs=1e-3)
    assert (two.value, two.high, two.low) == pytest.approx((0.0, 10 * one.high, 10 * one.low))


def _look(turn, causers, agent="a"):
    return {
        "term": "bump",
        "agent": agent,
        "turn": turn,
        "seed": 5,
        "paid": -1.0,
        "causers": causers,
        "of": 3,
    }


def test_penalties_count_what_others_did() -> None:
    """Own doing is right, another's is wrong, nobody's is unknown."""
    scans = [
        {"number": 1, "penalties": [_look(4, ["b"]), _look(2, ["a"]), _look(7, [])]},
        {"number": 0, "penalties": [_look(9, ["b", "c"])]},
    ]
    (found,) = penalties(scans)
    assert (found.wrong.n, found.unknown, dict(found.by)) == (3, 1, {"b": 2, "c": 1})
    assert found.wrong.p == pytest.approx(2 / 3)
    assert found.first is not None
    assert (found.first["episode"], found.first["turn"]) == (0, 9)


def test_influence_adds_up_over_episodes() -> None:
    """Looks and hits of all episodes make one interval."""
    scans = [{"influence": [["a", "b", "reward", 0, 1, 3]]}] * 2
    (row,) = influence(scans)
    assert (row["p"], row["n"]) == (pytest.approx(1 / 3, abs=1e-4), 6)
    assert row["low"] < row["p"] < row["high"]


def test_information_is_that_of_textbooks() -> None:
    """A fair coin told in full is one bit; unrelated ones tell nothing."""
    one = np.array([[0, 0, 1, 1]])
    assert information(one, one) == pytest.approx(1.0)
    assert information(one, np.array([[0, 1, 0, 1]])) == pytest.approx(0.0)


def test_dependence_of_a_constant_in_each_episode_needs_many_episodes() -> None:
    """What stays the same all episode long counts once for an episode, not for every turn."""
    rng = np.random.default_rng(1)
    found = [
        dependence(
            np.repeat(rng.integers(0, 3, (12, 1)), 40, axis=1),
            [np.repeat(rng.integers(0, 3, (12, 1)), 40, axis=1)],
            rng=rng,
        )[1]
        for _ in range(30)
    ]
    assert sum(p <= 0.05 for p in found) <= 5


def test_binned_keeps_few_values_and_cuts_many() -> None:
    """Categories stay, measurements come into equally full bins."""
    assert binned(np.array([[3.0, 7.0, 3.0]])).tolist() == [[0, 1, 0]]
    codes = binned(np.linspace(0, 1, 100).reshape(10, 10))
    assert np.bincount(codes.ravel()).tolist() == [25] * 4


class _Names:
    """A cast that says whose side an agent is on."""

    def __init__(self, name):
        self.name = name

    def begin(self, run_seed, episode):
        """Nothing to seed."""

    def act(self, agent, observation, info):
        """The side."""
        return self.name


class _Roster:
    agents = ("a_0", "a_1", "b_0")


@pytest.mark.parametrize(
    ("gone", "members", "side"),
    [
        ("a_0", ["a_0"], "own"),
        ("a_0", ["a_1"], "baseline"),
        ("a_1", ["a_0"], "baseline"),
        (None, ["a_0", "a_1"], "own"),
        (None, ["b_0"], "baseline"),
    ],
)
def test_who_joins_late_is_on_the_side_of_whom_it_follows(gone, members, side) -> None:
    """The one of its role who left last; where nobody left, most of its role."""
    env = _Roster()
    players = ["a_0", "a_1", "b_0"]
    runner: Any = SimpleNamespace(
        joint_policy=_Names("own"),
        baseline=_Names("baseline"),
        task=SimpleNamespace(players=players, others=["c_0"]),
        role_of=lambda a: a[0],
        env=env,
    )
    sides = Sides(runner, members)
    sides.begin(0, 0)
    for agent in players:
        expected = "own" if agent in members else "baseline"
        assert sides.act(agent, None, {}) == expected
    env.agents = tuple(a for a in (*players, "a_2") if a != gone)
    assert sides.act("a_2", None, {}) == side
    assert sides.act("c_0", None, {}) == "own"
