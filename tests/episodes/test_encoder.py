"""Batches and fingerprints don't depend on how the buffer was cut."""

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Text
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.episodes.digest import SIZE
from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.tables import merged_episodes, table_of
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from tests.episodes.buffers import BufferSink, Given, encoded, taped

SPACES: Any = {
    "a_0": Dict({"x": Box(0, 1, (2,), np.float32), "y": Text(5)}),
    "a_1": Dict({"x": Box(0, 1, (2,), np.float32), "y": Text(5)}),
    "b_0": Box(0, 255, (100, 100), np.uint8),
}
X = {"x": np.ones(2, np.float32), "y": "z"}
OBSERVATIONS: Any = {
    "a_0": [X, {**X, "y": "other"}, None],
    "a_1": [X, 3],
    "b_0": [np.full((100, 100), 7, np.uint8), np.zeros((100, 100), np.uint8), [1]],
}
STATES: Any = [np.array([1]), np.array([2]), ValueError("x"), [1], np.array([3])]


def sink_of(episodes: int = 3, ticks: int = 11) -> BufferSink:
    """A buffer with odd values, infos that vary, states that fail, agents that differ."""
    infos: Any = {"a_0": [{}, {"x": 1}, None], "b_0": [{"action_mask": np.ones(2, np.int8)}, {}]}
    env = Given(OBSERVATIONS, SPACES, infos=infos, states=STATES, rewards=[1.0, None, 2])
    return taped(env, ticks, episodes=episodes)


def tables_of(sink: BufferSink, most: int, level: str = "full") -> dict[str, pa.Table]:
    """All streams as tables."""
    batches: dict[str, list[pa.RecordBatch]] = {}
    for each in encoded(sink, most=most, level=level):
        for stream, batch in each.in_order():
            batches.setdefault(stream, []).append(batch)
    episodes = merged_episodes(batches.pop("episodes"))
    return {"episodes": episodes} | {name: table_of(parts) for name, parts in batches.items()}


@pytest.mark.parametrize("most", [1, 7])
def test_buffered_parts_of_any_length_give_the_same_tables(most: int) -> None:
    """Fingerprints, rows, states; times apart, which are no evidence."""
    whole, cut = tables_of(sink_of(), 1000), tables_of(sink_of(), most)
    for name in ("episodes", "agent_steps", "states"):
        assert whole[name].equals(cut[name].select(whole[name].schema.names)), name
    assert whole["timings"].num_rows == cut["timings"].num_rows == 33


@settings(max_examples=15)
@given(st.integers(1, 40))
def test_fingerprints_do_not_depend_on_buffered_parts(most: int) -> None:
    """Of episodes and of infos."""
    columns = ["fingerprint", "info_fingerprint"]
    expected = tables_of(sink_of(2, 5), 1000)["episodes"].select(columns).to_pylist()
    assert expected == tables_of(sink_of(2, 5), most)["episodes"].select(columns).to_pylist()


def test_states_that_come_and_go_do_not_depend_on_buffered_parts() -> None:
    """A reset that fails leaves turns without a state beside others with one."""

    class Reluctant(Given):
        resets = 0

        def reset(self, seed: Any = None, options: Any = None) -> Any:
            self.resets += 1
            if self.resets == 2:
                raise ValueError("not now")
            return super().reset(seed, options)

    found = []
    for most in (1, 2, 1000):
        env = Reluctant({"a": [0]}, {"a": Discrete(2)}, states=[np.array([1.0])])
        sink = BufferSink()

        wrapped = recorded_of(capture_of(env, sink=sink))
        wrapped.reset(seed=1)
        with pytest.raises(ValueError, match="not now"):
            wrapped.reset(seed=2)
        wrapped.reset(seed=1)
        wrapped._capture.end_episode()
        found.append(tables_of(sink, most)["episodes"]["fingerprint"].to_pylist())
    assert found[0] == found[1] == found[2]
    assert found[0][0] == found[0][2] != found[0][1]


def test_level_digest_has_digests_for_observations_and_the_same_fingerprints() -> None:
    """What else stands in a row stays."""
    full, digest = tables_of(sink_of(), 5), tables_of(sink_of(), 5, "digest")
    assert full["episodes"].equals(digest["episodes"])
    names = digest["agent_steps"].schema.names
    assert not [name for name in names if name.startswith("obs")]
    assert {SIZE} == {len(value) for value in digest["agent_steps"]["digest"].to_pylist()}
    shared = [name for name in names if name != "digest"]
    assert full["agent_steps"].select(shared).equals(digest["agent_steps"].select(shared))


def test_rows_stand_by_turn_order_agent() -> None:
    """Actors in their order, then the others by name."""
    env = Given({a: [0] for a in "cab"}, {a: Discrete(2) for a in "cab"})
    sink = BufferSink()

    wrapped = recorded_of(capture_of(env, sink=sink))
    wrapped.reset(seed=1)
    wrapped.step({"b": np.int64(1)})
    wrapped.step({"c": np.int64(0), "b": np.int64(1), "a": np.int64(0)})
    wrapped._capture.end_episode()
    steps = tables_of(sink, 9)["agent_steps"]
    assert list("baccbaabc") == steps["agent"].to_pylist()
    assert steps["order"].to_pylist() == [0, None, None, 0, 1, 2, None, None, None]


def test_episodes_merge_from_their_two_rows() -> None:
    """One that never ended has its start only."""
    rows = [
        {"episode": 1, "seed": 5, "since": 1},
        {"episode": 0, "seed": 4, "since": 0},
        {"episode": 0, "turns": 3, "end": "cut", "fingerprint": "ff"},
    ]
    batches = [pa.RecordBatch.from_pylist([row], schema=EPISODES) for row in rows]
    merged = merged_episodes(batches).to_pylist()
    assert [row["episode"] for row in merged] == [0, 1]
    assert tuple(merged[0][n] for n in ("seed", "turns", "end", "fingerprint")) == (
        4,
        3,
        "cut",
        "ff",
    )
    assert merged[1]["end"] is None


def test_columns_that_came_later_are_null_before() -> None:
    """An unannounced agent brings a column of its own."""

    class Late(Given):
        def step(self, actions: Any) -> Any:
            parts = super().step(actions)
            self.agents = ["a", "late"]
            for part, value in zip(
                parts, (np.float32([1, 2, 3]), 0.0, False, False, {}), strict=True
            ):
                part["late"] = value
            return parts

    late = Box(0, 9, (3,), np.float32)
    env = Late({"a": [0]}, {"a": Discrete(2), "late": late})
    env.possible_agents = ["a"]
    steps = tables_of(taped(env, 2), 1)["agent_steps"]
    assert steps["obs@late"].to_pylist() == [None, None, [1, 2, 3], None, [1, 2, 3]]
    assert steps["obs"].to_pylist() == [0, 0, None, 0, None]
