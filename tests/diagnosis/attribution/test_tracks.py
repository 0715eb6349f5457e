"""Scripts played again: as they were, and with one action done otherwise."""

from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium.spaces import Discrete

import gamekeeper as gk
from gamekeeper.diagnosis.attribution.attribution_work import first_difference
from gamekeeper.diagnosis.attribution.recorded_actions import Chooser, Swap, fingerprint
from gamekeeper.diagnosis.attribution.replacement_runs import (
    ReplacementRunner,
    ReplacementTask,
    script_from_json,
    script_to_json,
)
from gamekeeper.diagnosis.open_setup import setup_of
from gamekeeper.episodes.outcome import outcome_of

TASKS = ["two_robot_line", "warehouse_turns", "speaker_listener", "warehouse"]


def _runner(name, policies="random"):
    evidence = gk.rollout(name, policies=policies, episodes=2, seed=4)
    task = ReplacementTask(setup_of(evidence), evidence.contract, (), (), {}, 0, 9)
    return evidence, ReplacementRunner(task)


@pytest.mark.parametrize("name", TASKS)
def test_script_comes_out_as_recorded(name) -> None:
    """Every agent's k-th decision, done again, gives the recorded returns, twice."""
    evidence, runner = _runner(name)
    with runner:
        for episode in evidence.episodes:
            script = script_from_json(script_to_json(runner.script_of(episode)))
            one, two = (runner.from_script(script, sees=True) for _ in range(2))
            assert outcome_of(episode).team_return == pytest.approx(one.team_return())
            assert (one.left_script, first_difference(one, two)) == (0, None)


@pytest.mark.parametrize("name", ["warehouse", "warehouse_turns"])
def test_frozen_action_that_is_illegal_becomes_a_noop(name) -> None:
    """Where a frozen action isn't legal any more, nothing is done in its place."""
    evidence, runner = _runner(name)
    with runner:
        script = runner.script_of(evidence.episodes[0])
        changed = runner.from_script(script, Swap("picker_0", None, "noop"))
    assert {int(action) for action in changed.actions["picker_0"]} == {4}
    own = [
        (int(a), int(b))
        for name in changed.actions
        if name != "picker_0"
        for a, b in zip(script.actions[name], changed.actions[name], strict=False)
    ]
    assert all(b in (a, 4) for a, b in own)
    assert changed.left_script >= sum(a != b for a, b in own)


def test_other_action_of_a_huge_space_is_drawn_without_a_list() -> None:
    """A space of 2**40 actions costs no memory, and of two actions the other one is drawn."""
    rng = np.random.default_rng(0)
    for size in (2**40, 2):
        space = Discrete(size, start=3)
        chooser = Chooser("ant", SimpleNamespace(action_space=lambda _, s=space: s), gk.Contract())
        others = [chooser.other(np.int64(4), None, {}, rng) for _ in range(5)]
        assert all(other in space and other != 4 for other in others)
    assert [int(other) for other in others] == [3] * 5


def test_other_action_is_legal_and_another() -> None:
    """What takes an action's place is drawn from the legal ones but itself."""
    _, runner = _runner("warehouse")
    with runner:
        chooser = Chooser("picker_0", runner.env, runner.contract)
        rng = np.random.default_rng(0)
        info = {"action_mask": np.array([1, 0, 0, 0, 1, 0], np.int8)}
        assert {int(chooser.other(4, None, info, rng)) for _ in range(8)} == {0}
        info = {"action_mask": np.array([0, 0, 0, 0, 1, 0], np.int8)}
        assert chooser.other(4, None, info, rng) == 4
        assert [chooser.is_legal(a, None, info) for a in (0, 4, 9)] == [False, True, False]


def test_first_legal_action_stands_in_where_there_is_no_noop() -> None:
    """Without a noop the lowest legal action is taken."""
    _, runner = _runner("tictactoe")
    with runner:
        runner.env.reset(seed=0)
        chooser = Chooser(runner.env.possible_agents[0], runner.env, gk.Contract())
        mask = np.array([0, 0, 1, 1, 0, 0, 0, 0, 0], np.int8)
        assert int(chooser.nothing({"action_mask": mask}, {})) == 2


def test_fingerprint_tells_values_of_other_types_apart() -> None:
    """Equal values are equal, in any structure; NaN is itself."""
    one = {"a": np.array([1.0, np.nan]), "b": (1, [2])}
    assert fingerprint(one) == fingerprint({"a": np.array([1.0, np.nan]), "b": (1, [2])})
    assert fingerprint(np.int64(1)) != fingerprint(np.int32(1))
    assert len({fingerprint(one)}) == 1
