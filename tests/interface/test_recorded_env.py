"""Faces are PettingZoo environments that nobody can tell from the one behind them."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from mpe2 import simple_spread_v3
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.classic import rps_v2, tictactoe_v3
from pettingzoo.test import api_test, parallel_api_test
from pettingzoo.utils import wrappers

from gamekeeper.interface.aec_capture import AECCapture
from gamekeeper.interface.parallel_capture import ParallelCapture
from gamekeeper.interface.recorded_env import (
    RecordedAECEnv,
    RecordedParallelEnv,
    capture_of,
    recorded_of,
)
from gamekeeper.rollouts.memory import MemorySink
from tests.interface.capture_games import (
    NAMES,
    ScriptedAEC,
    ScriptedParallel,
    Turn,
    evidence_of,
    play_aec,
    play_parallel,
    recorded,
)


def test_faces_are_of_pettingzoos_classes() -> None:
    """Isinstance decides in trainers and wrappers."""
    parallel, _ = recorded(ScriptedParallel([Turn()]))
    aec, _ = recorded(ScriptedAEC([Turn()]))
    assert isinstance(parallel, ParallelEnv)
    assert isinstance(parallel, RecordedParallelEnv)
    assert isinstance(aec, AECEnv)
    assert isinstance(aec, RecordedAECEnv)
    assert not isinstance(aec, ParallelEnv)


@pytest.mark.filterwarnings("ignore::UserWarning")  # of PettingZoo's test, about the environment
@pytest.mark.parametrize("make", [tictactoe_v3.env, rps_v2.env, simple_spread_v3.env])
def test_aec_face_passes_pettingzoos_api_test(make: Any) -> None:
    """With the wrapper stack of the environment's own `env()` behind it."""
    wrapped, sink = recorded(make())
    api_test(wrapped, num_cycles=20)
    assert evidence_of(wrapped, sink).episode_table.num_rows > 0


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("make", [rps_v2.parallel_env, simple_spread_v3.parallel_env])
def test_parallel_face_passes_pettingzoos_api_test(make: Any) -> None:
    """Over a converter of PettingZoo too."""
    wrapped, sink = recorded(make())
    parallel_api_test(wrapped, num_cycles=20)
    assert evidence_of(wrapped, sink).episode_table.num_rows > 0


def test_faces_go_into_pettingzoos_wrappers() -> None:
    """A wrapper around a recorded environment records what goes through it."""
    wrapped, sink = recorded(ScriptedAEC([Turn()]))
    told = play_aec(wrappers.OrderEnforcingWrapper(wrapped), 5)
    assert told.lines == play_aec(ScriptedAEC([Turn()]), 5).lines
    assert evidence_of(wrapped, sink).episode(0).header["turns"] == 5


def test_books_of_an_aec_face_are_the_environments_own_objects() -> None:
    """The very dictionaries, so that who writes into them writes into the environment."""
    env = ScriptedAEC([Turn()])
    wrapped, _ = recorded(env)
    wrapped.reset(seed=1)
    for book in (
        "rewards",
        "_cumulative_rewards",
        "terminations",
        "truncations",
        "infos",
        "agents",
    ):
        assert getattr(wrapped, book) is getattr(env, book)
    assert wrapped.agent_selection == env.agent_selection
    assert wrapped.unwrapped is env
    assert str(wrapped) == str(env)
    assert wrapped.num_agents == env.num_agents
    assert wrapped.metadata is env.metadata


def test_books_are_not_there_before_the_first_reset() -> None:
    """As in the environment itself: hasattr says no."""
    bare, (wrapped, _) = ScriptedAEC([Turn()]), recorded(ScriptedAEC([Turn()]))
    for name in ("agents", "rewards", "agent_selection", "no_such_thing", "_private"):
        assert hasattr(bare, name) == hasattr(wrapped, name)


def test_what_is_set_on_a_face_is_set_on_the_environment() -> None:
    """Trainers set max_cycles, render_mode and such on what they hold."""
    env = ScriptedParallel([Turn()])
    wrapped, _ = recorded(env)
    wrapped.max_cycles = 7
    wrapped.agents = [NAMES[0]]
    assert env.max_cycles == 7
    assert env.agents == [NAMES[0]]
    assert "max_cycles" not in vars(wrapped)


@pytest.mark.parametrize("cls", [ScriptedParallel, ScriptedAEC])
@pytest.mark.parametrize(
    "copied",
    [copy.deepcopy, lambda wrapped: pickle.loads(pickle.dumps(wrapped))],
    ids=["copy", "pickle"],
)
def test_copy_of_a_face_plays_on_by_itself_and_is_not_recorded(cls: Any, copied: Any) -> None:
    """In the middle of an episode; the recording of the first goes on undisturbed."""
    play = play_parallel if cls is ScriptedParallel else play_aec
    wrapped, sink = recorded(cls([Turn(pays=((0, 1.0),))]))
    play(wrapped, 3)
    counterfactual = copied(wrapped)
    assert type(counterfactual) is type(wrapped)
    assert counterfactual.unwrapped is not wrapped.unwrapped
    assert counterfactual.agents == wrapped.agents
    assert play(counterfactual, 4).lines == play(cls([Turn(pays=((0, 1.0),))]), 4).lines
    assert evidence_of(wrapped, sink).episode_table["turns"].to_pylist() == [3]


def test_game_of_a_face_that_records_nothing_is_a_game_of_its_environment() -> None:
    """Recorded environments over each other would cost a layer each; one that records is kept."""
    env = ScriptedParallel([Turn()])
    plain = recorded_of(ParallelCapture(env))
    assert capture_of(plain).env is env
    wrapped, _ = recorded(env)
    assert capture_of(wrapped).env is wrapped
    assert isinstance(capture_of(ScriptedAEC([Turn()])), AECCapture)


def test_recording_a_recorded_face_gives_both_the_same_rows() -> None:
    """One may record inside of what another records."""
    inner, first = recorded(ScriptedAEC([Turn(pays=((1, 1.0),))]))
    outer, second = recorded(inner)
    play_aec(outer, 6)
    prints = [
        evidence_of(wrapped, sink).fingerprint
        for wrapped, sink in ((outer, second), (inner, first))
    ]
    assert prints[0] == prints[1]


def test_close_closes_the_environment_and_calls_back_once() -> None:
    """As often as it is called, the environment hears it; the recording is closed once."""
    closed: list[str] = []
    env = ScriptedParallel([Turn()])
    wrapped = recorded_of(
        capture_of(env, sink=MemorySink()), on_close=lambda: closed.append("closed")
    )
    play_parallel(wrapped, 2)
    wrapped.close()
    wrapped.close()
    assert env.calls.count("close") == 2
    assert closed == ["closed"]


def test_close_closes_the_environment_where_the_sink_fails() -> None:
    """A full disk is said, and no window stays open for it."""

    class Full(MemorySink):
        def keep_up(self) -> None:
            raise OSError("full")

    env = ScriptedParallel([Turn()])
    wrapped = recorded_of(capture_of(env, sink=Full()))
    wrapped.reset(seed=1)
    with pytest.raises(OSError, match="full"):
        wrapped.close()
    assert env.calls[-1] == "close"


def test_step_before_reset_is_the_environments_own_error() -> None:
    """The door adds no rule of its own."""
    wrapped, _ = recorded(wrappers.OrderEnforcingWrapper(ScriptedAEC([Turn()])))
    with pytest.raises(AttributeError, match="cannot be accessed before reset"):
        _ = wrapped.agents
    with pytest.raises(Exception, match="reset"):
        wrapped.step(np.int64(0))
