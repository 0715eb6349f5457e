"""The loop that plays: seeds by episode, policies by agent, cuts and ends."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete

from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.episode_loop import play
from gamekeeper.rollouts.memory import MemorySink
from tests.episodes.buffers import IDENTITY, Given
from tests.interface.capture_games import ScriptedAEC, ScriptedParallel, Turn


class Noting:
    """A cast that does 1 and notes what it was asked."""

    def __init__(self) -> None:
        self.begun: list[tuple[int, int]] = []
        self.asked: list[tuple[Any, Any, Any]] = []

    def begin(self, run_seed: int, episode: int) -> None:
        self.begun.append((run_seed, episode))

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        self.asked.append((agent, observation, info))
        return np.int64(1)


@pytest.mark.parametrize("cls", [ScriptedParallel, ScriptedAEC])
def test_episode_k_is_reset_with_its_own_seed(cls: Any) -> None:
    """Whichever episodes are played, in whatever order."""
    env, cast, sink = cls([Turn()]), Noting(), MemorySink()
    done: list[int] = []
    play(
        capture_of(env, sink=sink),
        cast,
        [3, 1],
        seed=7,
        most_turns=2,
        options={"a": 1},
        after_episode=done.append,
    )
    assert done == [1, 2]
    assert cast.begun == [(7, 3), (7, 1)]
    resets = [call for call in env.calls if call.startswith("reset")]
    assert [f"reset {episode_seed(7, k)} {{'a': 1}}" for k in (3, 1)] == resets
    evidence = sink.evidence(IDENTITY)
    assert [episode_seed(7, 3), episode_seed(7, 1)] == evidence.episode_table["seed"].to_pylist()


@pytest.mark.parametrize("cls", [ScriptedParallel, ScriptedAEC])
def test_long_episodes_are_cut_and_others_end(cls: Any) -> None:
    """At `most_turns`; after the end nobody is asked."""
    over = Turn(ends=((0, True), (1, True), (2, True)))
    for script, turns, end in (([Turn()], 4, "cut"), ([Turn(), over], None, "ended")):
        sink, ticked = MemorySink(), [0]

        def tick(ticked: list[int] = ticked) -> None:
            ticked[0] += 1

        capture = capture_of(cls(script), sink=sink)
        play(capture, Noting(), [0], seed=1, most_turns=turns or 99, after_turn=tick)
        episode = sink.evidence(IDENTITY).episode_table.to_pylist()[0]
        assert episode["end"] == end
        assert ticked[0] == episode["turns"]
        assert turns is None or episode["turns"] == turns


def test_everybody_live_is_asked_with_what_it_was_given() -> None:
    """Parallel: all of the roster; AEC: who is in turn, the ended not."""
    cast = Noting()
    play(capture_of(ScriptedParallel([Turn()])), cast, [0], seed=1, most_turns=2)
    assert [agent for agent, *_ in cast.asked] == ["agent_0", "agent_1", "agent_2"] * 2
    assert [float(seen[0]) for _, seen, _ in cast.asked] == [0.0] * 3 + [1.0] * 3
    cast = Noting()
    play(capture_of(ScriptedAEC([Turn(ends=((1, True),))])), cast, [0], seed=1, most_turns=3)
    assert [agent for agent, *_ in cast.asked] == ["agent_0", "agent_2"]


def test_environment_that_gives_no_dictionaries_is_played_on() -> None:
    """Its policies see nothing."""

    class Mute(Given):
        def reset(self, seed: Any = None, options: Any = None) -> Any:
            super().reset(seed, options)
            return None, None

    cast = Noting()
    play(capture_of(Mute({"a": [0]}, {"a": Discrete(2)})), cast, [0], seed=1, most_turns=1)
    assert cast.asked == [("a", None, None)]


def test_play_needs_no_recorder_and_plays_the_same() -> None:
    """A game without a sink makes the same calls, but for looks at the state."""
    calls = []
    for sink in (None, MemorySink()):
        env = ScriptedAEC([Turn(), Turn(joins=1), Turn(ends=((0, True),))])
        play(capture_of(env, sink=sink), Noting(), [0, 1], seed=1, most_turns=9)
        calls.append([call for call in env.calls if call != "state"])
    assert calls[0] == calls[1]
