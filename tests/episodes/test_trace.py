"""What was recorded reads back as it was, for every space and every oddity."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Graph, OneOf, Sequence, Space, Text
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.digest import EpisodeDigest, episode_header
from gamekeeper.episodes.episode import Turn, digests_of
from gamekeeper.episodes.spaces import Codec
from tests.episodes.buffers import Given, record
from tests.episodes.drawn_spaces import FIXED, SPACES, sample
from tests.episodes.sameness import same

few = settings(max_examples=40)


def granted(space: Space[Any], value: Any) -> Any:
    """The value as its space has it: a scalar for an array without dimensions is one, and such."""
    codec = Codec(space)
    payloads = codec.pack(value)
    assert payloads is not None
    return codec.unpack(payloads)


def turns_of(env: Any, ticks: int = 2, **settings: Any) -> list[Turn]:
    """The turns of one recorded episode."""
    return list(record(env, ticks, **settings).episode(0).turns)


@few
@given(SPACES, st.integers(0, 9))
def test_values_of_every_space_read_back_exactly(space: Space[Any], seed: int) -> None:
    """As observations and as actions: values, types, dtypes, shapes."""
    values = [sample(space, seed + place) for place in range(3)]
    env = Given({"a": values}, {"a": space}, actions=space)
    turns = turns_of(env, actions=values)
    for turn, value in zip(turns, values, strict=True):
        found = turn.observations["a"]
        assert same(found, granted(space, value))
        assert turn.nonconforming == {}
    for turn, value in zip(turns[:2], values[:2], strict=True):
        found = turn.actions["a"]
        assert same(found, granted(space, value))


@few
@given(st.lists(SPACES, min_size=2, max_size=4), st.integers(0, 9))
def test_agents_of_different_spaces_read_back_exactly(spaces: list[Space[Any]], seed: int) -> None:
    """Columns of their own, named after their group, null for all others."""
    agents = {f"agent_{place}": space for place, space in enumerate(spaces)}
    values = {agent: [sample(space, seed)] for agent, space in agents.items()}
    evidence = record(Given(values, agents), 1)
    turn = evidence.episode(0).turns[0]
    for agent, (value,) in values.items():
        assert same(turn.observations[agent], granted(agents[agent], value))


@few
@given(FIXED, st.integers(0, 9))
def test_rows_digest_alike_before_and_after_arrow(space: Space[Any], seed: int) -> None:
    """What a reader computes from columns is what the recorder computed from values."""
    values = [sample(space, seed + place) for place in range(3)] + ["nonconforming"]
    evidence = record(Given({"a": values, "b": values[::-1]}, {"a": space, "b": space}), 4)
    digest = EpisodeDigest(episode_header(seed=1, options=None))
    digest.add_rows(digests_of(evidence.episode(0).steps))
    assert evidence.episode_table["fingerprint"].to_pylist() == [digest.fingerprint]


@pytest.mark.parametrize(
    ("space", "value"),
    [
        (Box(-1, 1, (3,), np.float32), np.array([np.nan, -0.0, np.inf], np.float32)),
        (Box(-1, 1, (2,), np.float16), np.array([np.nan, 9], np.float16)),
        (Box(0, 255, (96, 96, 3), np.uint8), np.arange(27648, dtype=np.uint8).reshape(96, 96, 3)),
        (Box(0, 1, (0,), np.float32), np.zeros(0, np.float32)),
        (Box(0, 1, (), np.float64), np.array(0.5)),
        (Text(9), "ä\n'\""),
        (Dict({}), {}),
        (Sequence(Discrete(3)), ()),
        (OneOf([Discrete(2), Text(3)]), (np.int64(1), "a")),
    ],
)
def test_edges_of_spaces_read_back_exactly(space: Space[Any], value: Any) -> None:
    """Out of bounds, empty, large, without dimensions."""
    turn = turns_of(Given({"a": [value]}, {"a": space}))[0]
    assert same(value, turn.observations["a"])
    assert turn.nonconforming == {}


def test_graph_reads_back() -> None:
    """Nodes, edges and links."""
    space = Graph(Box(0, 1, (2,), np.float32), Discrete(3))
    value = sample(space, 3)
    found = turns_of(Given({"a": [value]}, {"a": space}))[0].observations["a"]
    assert to_json(found) == to_json(value)


@pytest.mark.parametrize("dtype", ["i1", "u1", "?"])
@pytest.mark.parametrize("shape", [(4,), (2, 3), ()])
def test_masks_in_infos_read_back_with_dtype_and_shape(dtype: str, shape: tuple[int, ...]) -> None:
    """They stand in a column of bytes; the info says of what dtype and shape."""
    mask = np.ones(shape, dtype)
    env = Given({"a": [0]}, {"a": Discrete(2)}, infos={"a": [{"action_mask": mask, "x": 1}, {}]})
    evidence = record(env, 2)
    first, second, _ = evidence.episode(0).turns
    assert same(mask, first.infos["a"]["action_mask"])
    assert same(mask, first.masks["a"])
    assert first.infos["a"]["x"] == 1
    assert dict(second.masks) == {}
    assert second.infos["a"] == {}
    assert [mask.tobytes(), None, mask.tobytes()] == evidence.agent_steps["action_mask"].to_pylist()


def test_masks_of_wider_elements_and_in_observations_are_found() -> None:
    """A mask may be of floats, or stand in the observation, whose mask comes first."""
    space = Dict({"observation": Discrete(2), "action_mask": Box(0, 1, (3,), np.int8)})
    mask, other = np.array([1, 0, 1], np.int8), np.ones(3)
    env = Given(
        {"a": [{"observation": 0, "action_mask": mask}], "b": [0]},
        {"a": space, "b": Discrete(2)},
        infos={"a": [{"action_mask": other}], "b": [{"action_mask": other}]},
    )
    turn = turns_of(env)[0]
    assert same(mask, turn.masks["a"])
    assert same(other, turn.masks["b"])
    assert same(other, turn.infos["a"]["action_mask"])


def test_states_read_back_whatever_they_are() -> None:
    """Arrays in columns, others as odd; where it raised, and where the shape changed."""
    states = [np.array([1, 2]), np.array([3.5, 4]), [1, "x"], ValueError("no"), None]
    env = Given({"a": [0]}, {"a": Discrete(2)}, states=states)
    episode = record(env, 4).episode(0)
    assert same(states[0], episode.state(0))
    assert same(states[1], episode.state(1))
    assert episode.state(2) == [1, "x"]
    assert episode.state(3) is None
    assert episode.states["nonconforming"].to_pylist()[3] == '{"state":{"raised":"ValueError"}}'
    assert episode.state(99) is None


@pytest.mark.parametrize(
    "value",
    [np.int64(3), np.float64(0.5), np.bool_(True), np.str_("x"), (1, 2), b"x", {1: 2}, None],
)
def test_nonconforming_values_read_back_with_their_types(value: Any) -> None:
    """Scalars of numpy that JSON writes as plain numbers too."""
    turn = turns_of(Given({"a": [value]}, {"a": Box(0, 1, (2,), np.float32)}))[0]
    assert same(value, turn.observations["a"])
    assert same(value, turn.nonconforming["a"]["obs"]["value"])


def test_unseeded_and_option_headers_read_back() -> None:
    """Options as they were; `at` names a place."""
    episode = record(
        Given({"a": [0]}, {"a": Discrete(2)}), 1, seed=None, options={"k": (1,)}
    ).episode(0)
    assert episode.seed is None
    assert episode.options == {"k": (1,)}
    assert str(episode.at(3, "a", "rewards")) == "episode 0, turn 3, rewards['a']"
    assert len(episode) == 2
    assert not episode.is_digest
