"""A packed episode holds what the rows say, as a reader would read them row by row."""

import json
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gamekeeper as gk
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import outcome_of
from gamekeeper.reporting.page.episode_list import entries_of, packed_of
from gamekeeper.reporting.page.packed_episode import deflated, packed_agents, packed_episode
from gamekeeper.reporting.page.packed_values import MOST_CHARACTERS, PackedValues, plain_of_text
from tests.reporting.page.games import recorded

SPECS = ["warehouse", "aec:tictactoe", "handover", "mpe2.simple_tag_v3:parallel_env"]


@pytest.fixture(scope="module", params=SPECS)
def evidence(request: pytest.FixtureRequest) -> Evidence:
    """Two episodes of an environment, Parallel and AEC."""
    return gk.rollout(request.param, episodes=2, seed=3)


def test_rows_say_what_turns_say(evidence: Evidence) -> None:
    """Every turn's actions, order, rewards, terms, flags and masks stand in the columns."""
    for episode in evidence.episodes:
        packed = packed_of(evidence, episode.episode)
        rows, values = packed["rows"], packed["values"]
        names = [agent["name"] for agent in packed["agents"]]
        at = {(rows["turn"][k], names[rows["agent"][k]]): k for k in range(len(rows["turn"]))}
        for turn in episode.turns:
            for agent in turn.agents:
                k = at.pop((turn.index, agent))
                assert rows["reward"][k] == pytest.approx(turn.rewards.get(agent))
                assert rows["cumulative_reward"][k] == pytest.approx(
                    turn.cumulative_reward.get(agent)
                )
                for name in ("terminated", "truncated"):
                    flag = getattr(turn, name).get(agent)
                    assert rows[name][k] == (None if flag is None else int(flag))
                acted = agent in turn.order
                assert (rows["order"][k] is not None) is acted
                if agent in turn.actions:
                    told = np.asarray(turn.actions[agent]).tolist()
                    assert values[rows["action"][k]] == pytest.approx(told)
                if agent in turn.masks:
                    assert values[rows["mask"][k]] == np.asarray(turn.masks[agent]).tolist()
                for term, value in turn.terms.get(agent, {}).items():
                    assert rows["terms"][term][k] == pytest.approx(value)
        assert at == {}


def test_columns_are_of_one_length_and_json(evidence: Evidence) -> None:
    """Columns are equally long, places are in range, and all of it is plain JSON, deflated raw."""
    packed = packed_of(evidence, 1, run="b")
    rows = {**packed["rows"], **packed["rows"]["terms"]}
    del rows["terms"]
    assert {len(packed["rows"]["turn"])} == {len(column) for column in rows.values()}
    for name in ("action", "mask", "info", "nonconforming"):
        assert all(place is None or 0 <= place < len(packed["values"]) for place in rows[name])
    again = json.loads(zlib.decompress(deflated(packed), -zlib.MAX_WBITS))
    assert json.loads(json.dumps(packed)) == again
    assert (again["run"], again["episode"], again["end"]) == ("b", 1, "ended")


def test_numbers_are_the_outcome(evidence: Evidence) -> None:
    """Returns and endings of a packed episode and of the list are those of its outcome."""
    for entry, episode in zip(entries_of(evidence), evidence.episodes, strict=True):
        outcome, packed = outcome_of(episode), packed_of(evidence, episode.episode)
        returns = {agent: each["return"] for agent, each in packed["numbers"].items()}
        assert outcome.returns == pytest.approx(returns)
        assert outcome.returns == pytest.approx(entry["returns"])
        assert outcome.turns == packed["turns"] == entry["turns"]
        for agent, end in packed["endings"].items():
            assert outcome.flags[agent] == end["how"]
            assert outcome.endings[agent] == (end["reason"] or end["how"])


def test_many_endings_alike_are_one_mark() -> None:
    """Four agents that end alike share a mark; two have one each."""
    few = packed_of(recorded(episodes=1), 0)["marks"]
    many = packed_of(recorded(episodes=1, agents=[f"a_{k}" for k in range(4)]), 0)["marks"]
    assert [mark["agent"] for mark in few] == ["one_0", "one_1"]
    assert [mark["text"] for mark in many] == ["4 agents terminated: word"]


def test_failing_episode_is_marked() -> None:
    """Where the contract's condition holds, or the one asked for, the episode's end says so."""
    evidence = recorded(failure="gain < 100", episodes=1)
    marks = packed_of(evidence, 0)["marks"]
    assert "gain < 100" in [mark["text"] for mark in marks]
    assert [entry["failing"] for entry in entries_of(evidence)] == [True]
    asked = packed_of(evidence, 0, condition="length >= 0")["marks"]
    assert [mark["text"] for mark in asked if mark["kind"] == "failure"] == ["length >= 0"]


def test_labels_are_marked() -> None:
    """A label of the episode is a mark at its turn, one of another episode isn't."""
    label = {
        "label": "planning",
        "agent": "one_0",
        "episode": 0,
        "turn": 2,
        "why": "why not",
        "by": "me",
        "at": "",
        "proposed": False,
    }
    evidence = recorded(episodes=2)
    marks = packed_of(evidence, 0, labels=[label])["marks"]
    assert (2, "label", "planning: why not", "one_0") in [
        (mark["turn"], mark["kind"], mark["text"], mark["agent"]) for mark in marks
    ]
    assert "label" not in [mark["kind"] for mark in packed_of(evidence, 1, labels=[label])["marks"]]
    entries = entries_of(evidence, labels=[label])
    assert [entry["labels"] for entry in entries] == [["planning"], []]


def test_rewards_that_are_not_finite_are_told() -> None:
    """NaN stands as a word among the odd things, and JSON stays JSON."""
    evidence = recorded(episodes=1)
    steps = evidence.agent_steps
    rewards = steps["reward"].to_numpy().copy()
    rewards[0] = np.nan
    place = steps.schema.get_field_index("reward")
    episode = evidence.episode(0)
    object.__setattr__(episode, "steps", steps.set_column(place, "reward", [rewards]))
    packed = packed_episode(episode, packed_agents(evidence))
    assert packed["rows"]["reward"][0] is None
    assert packed["values"][packed["rows"]["nonconforming"][0]] == {"reward": "nan"}
    json.dumps(packed, allow_nan=False)


SCALARS = st.none() | st.booleans() | st.integers() | st.floats()
TEXTS = st.text(max_size=5) | st.binary(max_size=4)


def around(inner: st.SearchStrategy[object]) -> st.SearchStrategy[object]:
    """Values that hold others."""
    keyed = st.dictionaries(st.text(max_size=3), inner, max_size=3)
    return st.lists(inner, max_size=3) | keyed | st.tuples(inner, inner)


@given(st.recursive(SCALARS | TEXTS, around, max_leaves=8))
def test_any_recorded_value_becomes_plain_json(value: object) -> None:
    """Whatever canonical JSON was written from, the page's value is JSON without NaN."""
    plain = plain_of_text(to_json(value))
    assert plain == json.loads(json.dumps(plain, allow_nan=False))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.arange(3, dtype=np.int32), [0, 1, 2]),
        (np.zeros((2, 2), np.float32), [[0.0, 0.0], [0.0, 0.0]]),
        (np.zeros(1_000, np.float32), "array <f4 [1000]"),
        (np.arange(100, dtype=np.uint8), list(range(100))),
        (float("nan"), "NaN"),
        ((1, 2), [1, 2]),
        ({1: "a"}, {"1": "a"}),
        (b"abc", "3 bytes"),
        (np.float32(0.5), 0.5),
        (object, "<class 'object'>"),
    ],
)
def test_special_values_read_as_they_are_meant(value: object, expected: object) -> None:
    """Arrays are lists, large ones words; NaN, tuples, keys and bytes are what a reader expects."""
    assert expected == plain_of_text(to_json(value))


def test_damaged_and_long_texts_are_shown_bounded() -> None:
    """What can't be read is shown as it stands; what is long is cut, with its length."""
    assert plain_of_text("{no json") == "{no json"
    values = PackedValues()
    place = values.place("x" * 10_000)
    assert len(values.items[place]) < MOST_CHARACTERS + 40
    assert "10,002 characters" in values.items[place]
    assert values.place([1]) == values.place([1])
