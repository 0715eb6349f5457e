from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.core.divergence import compare
from gamekeeper.core.trace import Trace
from gamekeeper.game.faces import game_of
from gamekeeper.record.recording import cast_of, rollout
from gamekeeper.run.memory import MemorySink
from gamekeeper.run.play import play
from gamekeeper.run.rerun import replay_trace
from tests.record.walks import Turns, Walk


def rerun(trace: Trace, env: Any, **options: Any) -> Trace:
    """What a trace comes to, played again in an environment."""
    sink = MemorySink()
    game = game_of(env, sink=sink)
    game.episode = trace.episode - 1
    agents = {str(agent): agent for agent in env.possible_agents}
    replay_trace(trace, game, agents=agents, **options)
    return next(sink.evidence({"name": "x", "api": game.api, "kwargs": {}}).traces)


@pytest.mark.parametrize("kind", [Walk, Turns])
def test_rerun_plays_the_same_again(kind: type) -> None:
    """Recorded actions from a recorded seed come to the same rows."""
    for trace in rollout(kind(), episodes=3, seed=2).traces:
        assert compare(trace, rerun(trace, kind())).is_exact


@pytest.mark.parametrize("kind", [Walk, Turns])
def test_rerun_closes_the_loop(kind: type) -> None:
    """Policies that choose anew from the recorded seed choose the same."""
    evidence = rollout(kind(), episodes=2, seed=2, policies={"a": "random", "b": "first-legal"})
    for trace in evidence.traces:
        env = kind()
        cast = cast_of({"a": "random", "b": "first-legal"}, env, None)

        assert compare(trace, rerun(trace, env, cast=cast, run_seed=2)).is_exact


def test_rerun_reports_every_turn() -> None:
    """Each crossing is a sign of life."""
    trace = next(rollout(Walk(), episodes=1).traces)
    turns: list[int] = []

    rerun(trace, Walk(), after_turn=lambda: turns.append(1))

    assert len(turns) == 5


def test_rerun_stops_where_the_environment_raises() -> None:
    """An environment that raises where none raised before ends the episode as failed."""

    class Breaks(Walk):
        def step(self, actions: Any) -> Any:
            if self.turn == 2:
                raise ZeroDivisionError
            return super().step(actions)

    again = rerun(next(rollout(Walk(), episodes=1).traces), Breaks())

    assert (again.header["end"], again.header["turns"]) == ("failed", 3)


def test_rerun_stops_where_everybody_has_left() -> None:
    """Actions that were recorded beyond the end of the episode aren't handed over."""
    again = rerun(next(rollout(Walk(), episodes=1).traces), Walk(turns=2))

    assert (again.header["end"], again.header["turns"]) == ("ended", 2)


@pytest.mark.parametrize("names", [[0, 1], [("row", 1), ("row", 2)], ["a", 1]])
def test_rerun_knows_agents_whatever_they_are(names: list[Any]) -> None:
    """Agents that are no texts get their actions again, by what they are."""

    class Named(Walk):
        def __init__(self) -> None:
            super().__init__()
            self.possible_agents = names
            self.observation_spaces = {n: spaces.Box(-99, 99, (3,), np.float64) for n in names}
            self.action_spaces = {n: spaces.Discrete(3) for n in names}

        def step(self, actions: Any) -> Any:
            assert set(actions) <= set(names)
            return super().step(actions)

    trace = next(rollout(Named(), episodes=1).traces)

    assert compare(trace, rerun(trace, Named())).is_exact


def test_rerun_of_nothing_resets_once() -> None:
    """A trace without turns is a reset without turns."""
    env, sink = Walk(), MemorySink()
    game = game_of(env, sink=sink)
    play(game, cast_of("random", env, None), range(1), seed=0, most_turns=0)
    trace = next(sink.evidence({"name": "x", "api": "parallel", "kwargs": {}}).traces)

    assert compare(trace, rerun(trace, Walk())).is_exact
