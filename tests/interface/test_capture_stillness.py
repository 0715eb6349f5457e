"""The recorder does not disturb: same values, same calls, whatever an environment does."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.episodes.canonical import to_json
from tests.interface.capture_games import (
    NAMES,
    NONCONFORMING_PARTS,
    SCRIPTS,
    STRANGE_PAY,
    ScriptedAEC,
    ScriptedParallel,
    Turn,
    evidence_of,
    play_aec,
    play_parallel,
    recorded,
    without_looks,
)

TICKS = 15
few = settings(max_examples=40)


@few
@given(SCRIPTS)
def test_recorded_parallel_run_equals_the_bare_one(script: list[Turn]) -> None:
    """Values and calls are the same with and without a recorder."""
    bare = ScriptedParallel(script)
    env = ScriptedParallel(script)
    wrapped, sink = recorded(env)
    assert play_parallel(bare, TICKS).lines == play_parallel(wrapped, TICKS).lines
    assert bare.calls == without_looks(env.calls)
    evidence_of(wrapped, sink)


@few
@given(SCRIPTS, st.booleans())
def test_recorded_aec_run_equals_the_bare_one(script: list[Turn], observe: bool) -> None:
    """Values and calls are the same with and without a recorder."""
    bare, env = ScriptedAEC(script), ScriptedAEC(script)
    wrapped, sink = recorded(env)
    told = play_aec(bare, TICKS, observe=observe)
    assert told.lines == play_aec(wrapped, TICKS, observe=observe).lines
    assert bare.calls == without_looks(env.calls)
    evidence_of(wrapped, sink)


@few
@given(SCRIPTS, NONCONFORMING_PARTS, st.integers(0, 3))
def test_nonconforming_parts_of_a_tick_reach_the_caller_and_stop_nothing(
    script: list[Turn], part: Any, at: int
) -> None:
    """What a step returns may be no dictionaries at all; the recorder raises nothing of its own."""
    script = [replace(turn, strange=part if i == at else None) for i, turn in enumerate(script)]
    bare, env = ScriptedParallel(script), ScriptedParallel(script)
    wrapped, sink = recorded(env)
    assert play_parallel(bare, TICKS).lines == play_parallel(wrapped, TICKS).lines
    evidence = evidence_of(wrapped, sink)
    assert len(list(evidence.episodes)) == 1


@few
@given(st.lists(STRANGE_PAY, min_size=1, max_size=6))
def test_rewards_that_are_no_numbers_reach_the_caller_unchanged(pays: list[Any]) -> None:
    """None, texts, bools, arrays and NaN as rewards pass through the door."""
    script = [Turn(pays=((i, pay),)) for i, pay in enumerate(pays)]
    wrapped, sink = recorded(ScriptedParallel(script))
    lines = play_parallel(ScriptedParallel(script), len(script)).lines
    assert lines == play_parallel(wrapped, len(script)).lines
    evidence_of(wrapped, sink)


def test_state_is_probed_once_and_then_seen_once_a_turn() -> None:
    """One look to see whether it draws, one at the reset, one after each step."""
    env = ScriptedParallel([Turn()])
    wrapped, _ = recorded(env)
    play_parallel(wrapped, 5)
    assert env.calls.count("state") == 1 + 1 + 5
    play_parallel(wrapped, 2)
    assert env.calls.count("state") == 7 + 1 + 2
    assert env.calls.count("render") == 0


def test_frames_are_rendered_once_a_turn_only_where_asked_for() -> None:
    """One probe, one frame at the reset, one after each turn."""
    env = ScriptedAEC([Turn()])
    wrapped, sink = recorded(env, frames=True, state=False)
    play_aec(wrapped, 4)
    assert env.calls.count("render") == 1 + 1 + 4
    assert env.calls.count("state") == 0
    assert [(0, turn) for turn in range(5)] == sorted(sink.frames)


def test_state_that_draws_is_not_looked_at() -> None:
    """A state() that moves the environment's generator is put back and never called again."""

    class Drawing(ScriptedParallel):
        def __init__(self, script: list[Turn]) -> None:
            super().__init__(script)
            self.rng = np.random.default_rng(3)

        def state(self) -> Any:
            self.calls.append("state")
            return self.rng.integers(9)

    env = Drawing([Turn()])
    wrapped, sink = recorded(env)
    play_parallel(wrapped, 4)
    assert env.calls.count("state") == 1
    assert int(np.random.default_rng(3).integers(9)) == int(env.rng.integers(9))
    assert evidence_of(wrapped, sink).states is None


def test_render_that_fails_later_costs_a_frame_only() -> None:
    """A render() that raises in the middle of an episode doesn't stop the caller's step."""

    class Blind(ScriptedParallel):
        def render(self) -> str:
            if self.turn == 2:
                raise RuntimeError("no window")
            return super().render()

    wrapped, sink = recorded(Blind([Turn()]), frames=True)
    play_parallel(wrapped, 4)
    assert [turn for _, turn in sorted(sink.frames)] == [0, 1, 3, 4]


def test_defaultdicts_of_an_environment_get_no_new_keys() -> None:
    """Looking for an agent that a defaultdict lacks would make an entry of it."""
    from collections import defaultdict

    class Sparse(ScriptedParallel):
        def step(self, actions: Any) -> Any:
            observations, _, *rest = super().step(actions)
            self.rewards: Any = defaultdict(float, {NAMES[0]: 1.0, "ghost": 0.0, "other": 0.0})
            return observations, self.rewards, *rest

    env = Sparse([Turn()])
    wrapped, _ = recorded(env)
    play_parallel(wrapped, 3)
    assert {NAMES[0]: 1.0, "ghost": 0.0, "other": 0.0} == dict(env.rewards)


def test_mutating_what_was_returned_changes_no_evidence() -> None:
    """The recorder keeps values, not references to what the caller may write into."""
    evidences = []
    for writes in (False, True):
        wrapped, sink = recorded(ScriptedParallel([Turn(pays=((0, 1.0),))]))
        observations, _ = wrapped.reset(seed=1)
        for _ in range(3):
            if writes:
                observations[NAMES[0]][:] = 77
            observations, rewards, *_ = wrapped.step(dict.fromkeys(wrapped.agents, np.int64(1)))
            if writes:
                rewards.clear()
        evidences.append(evidence_of(wrapped, sink).fingerprint)
    assert evidences[0] == evidences[1]


@pytest.mark.parametrize("cls", [ScriptedParallel, ScriptedAEC])
def test_reset_gets_the_arguments_that_the_caller_gave(cls: Any) -> None:
    """Seed and options pass on; what wasn't given isn't."""
    env = cls([Turn()])
    wrapped, _ = recorded(env)
    wrapped.reset()
    wrapped.reset(seed=3)
    wrapped.reset(seed=4, options={"a": 1})
    resets = [call for call in env.calls if call.startswith("reset")]
    assert resets == ["reset None None", "reset 3 None", "reset 4 {'a': 1}"]
    assert to_json({"a": 1}) == wrapped._capture._buffer.starts[-1].options
