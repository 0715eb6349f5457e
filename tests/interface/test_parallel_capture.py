"""Rows of Parallel environments: who was given what, did what, and was paid for it."""

from collections import OrderedDict
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from tests.interface.capture_games import (
    ACTIONS,
    NAMES,
    SCRIPTS,
    ScriptedParallel,
    ScriptError,
    Turn,
    evidence_of,
    play_parallel,
    recorded,
)

A, B, C = NAMES[:3]
few = settings(max_examples=40)


def episode_of(script: list[Turn], ticks: int, n: int = 3) -> Episode:
    """The episode of an episode played from a script."""
    wrapped, sink = recorded(ScriptedParallel(script, n))
    play_parallel(wrapped, ticks)
    return evidence_of(wrapped, sink).episode(0)


def paid_in(evidence: Evidence) -> dict[str, float]:
    """What rows say that each agent was paid, its odd payments left out."""
    table = evidence.agent_steps.group_by("agent").aggregate([("reward", "sum")]).to_pydict()
    return dict(zip(table["agent"], table["reward_sum"], strict=True))


@few
@given(SCRIPTS)
def test_rows_pay_each_agent_what_every_step_did(script: list[Turn]) -> None:
    """The sum of rewards over rows is the sum of what every step returned."""
    wrapped, sink = recorded(ScriptedParallel(script))
    told = play_parallel(wrapped, 15)
    paid = paid_in(evidence_of(wrapped, sink))
    for agent, amounts in told.paid.items():
        assert float(sum(map(float, amounts))) == pytest.approx(paid.get(agent) or 0.0, abs=1e-6)


@few
@given(SCRIPTS)
def test_rows_of_a_turn_are_its_live_agents_and_those_who_end(script: list[Turn]) -> None:
    """Each (turn, agent) stands once; received is what the step before paid."""
    episode = episode_of(script, 15)
    before: Any = None
    for turn in episode.turns:
        assert len(turn.agents) == len(set(turn.agents))
        assert turn.live <= set(turn.agents)
        if before is not None and not before.raised:
            for agent, amount in turn.cumulative_reward.items():
                assert amount == before.rewards.get(agent, 0.0)
        before = turn


@few
@given(SCRIPTS)
def test_rows_are_the_same_by_the_short_look_and_the_whole(script: list[Turn]) -> None:
    """What comes in plain dictionaries is taken down as what comes in others."""

    class Other(ScriptedParallel):
        def reset(self, seed: Any = None, options: Any = None) -> Any:
            return tuple(map(OrderedDict, super().reset(seed, options)))

        def step(self, actions: Any) -> Any:
            return tuple(map(OrderedDict, super().step(actions)))

    rows = []
    for env in (ScriptedParallel(script), Other(script)):
        wrapped, sink = recorded(env)
        play_parallel(wrapped, 15)
        rows.append(evidence_of(wrapped, sink).agent_steps.to_pydict())
    assert repr(rows[0]) == repr(rows[1])


def test_turn_is_a_tick_with_a_last_row_for_the_end() -> None:
    """Two ticks are two turns with actions, and closing rows after them."""
    episode = episode_of([Turn(), Turn(ends=((0, True), (1, False), (2, True)))], 9)
    turns = list(episode.turns)
    assert [turn.index for turn in turns] == [0, 1, 2]
    assert [turn.order for turn in turns] == [(A, B, C), (A, B, C), ()]
    assert turns[2].agents == (A, B, C)
    assert turns[2].live == frozenset()
    assert turns[2].terminated == {A: True, B: False, C: True}
    assert turns[2].truncated == {A: False, B: True, C: False}
    assert episode.header["end"] == "ended"
    assert episode.header["turns"] == 2


def test_order_is_that_of_the_action_dictionary() -> None:
    """An agent's place is its action's place in the dictionary, whatever the roster says."""
    wrapped, sink = recorded(ScriptedParallel([Turn()]))
    wrapped.reset(seed=1)
    wrapped.step({C: np.int64(0), A: np.int64(1), B: np.int64(2)})
    wrapped.step({B: np.int64(0)})
    wrapped.step({A: np.int64(0), "stranger": np.int64(1)})
    turns = list(evidence_of(wrapped, sink).episode(0).turns)
    assert [turn.order for turn in turns] == [(C, A, B), (B,), (A, "stranger"), ()]
    assert dict(turns[0].actions) == {A: 1, B: 2, C: 0}
    assert turns[1].agents == (B, A, C)
    assert "stranger" not in turns[2].live
    assert turns[2].cumulative_reward == {A: 0.0, B: 0.0, C: 0.0}


def test_newcomer_is_paid_at_the_turn_that_brought_it() -> None:
    """One is paid as it joins, while another leaves: as many rewards as before, of other agents."""

    class Swap(ScriptedParallel):
        def step(self, actions: Any) -> Any:
            super().step(actions)
            self.agents = [B, C, "late"]
            every: Any = [dict.fromkeys(self.agents, value) for value in (0.0, False, False)]
            every[0]["late"] = 5.0
            return (
                {a: np.zeros(2, np.float32) for a in self.agents},
                *every,
                {a: {} for a in self.agents},
            )

    wrapped, sink = recorded(Swap([Turn()]))
    play_parallel(wrapped, 1)
    turn, closing = evidence_of(wrapped, sink).episode(0).turns
    assert turn.rewards == {B: 0.0, C: 0.0, "late": 5.0}
    assert "late" not in turn.live
    assert closing.live == {B, C, "late"}
    assert closing.cumulative_reward["late"] == 5.0


def test_missing_keys_are_told_from_values() -> None:
    """An agent without an entry is odd with the type `missing`, and has no value."""

    class Partial(ScriptedParallel):
        def step(self, actions: Any) -> Any:
            parts = super().step(actions)
            for part in parts:
                part.pop(B)
            return parts

    wrapped, sink = recorded(Partial([Turn()]))
    play_parallel(wrapped, 1)
    closing = evidence_of(wrapped, sink).episode(0).turns[-1]
    fields = {"obs", "cumulative_reward", "terminated", "truncated", "info"}
    assert {name: {"type": "missing"} for name in fields} == closing.nonconforming[B]
    assert B in closing.live
    assert B not in closing.observations
    assert B not in closing.infos


@pytest.mark.parametrize(
    ("part", "field", "value", "type_name"),
    [
        ("observations", "obs", [1.0, 2.0], "list"),
        ("observations", "obs", np.zeros(2), "numpy.ndarray"),
        ("rewards", "cumulative_reward", None, "NoneType"),
        ("rewards", "cumulative_reward", "2", "str"),
        ("rewards", "cumulative_reward", True, "bool"),
        ("rewards", "cumulative_reward", np.array([1.0]), "numpy.ndarray"),
        ("rewards", "cumulative_reward", np.int64(2**60), "numpy.int64"),
        ("terminations", "terminated", 1, "int"),
        ("truncations", "truncated", None, "NoneType"),
        ("terminations", "terminated", np.array([True, False]), "numpy.ndarray"),
        ("infos", "info", None, "NoneType"),
        ("infos", "info", "note", "str"),
    ],
)
def test_value_that_does_not_conform_is_kept_as_it_was(
    part: str, field: str, value: Any, type_name: str
) -> None:
    """Its column is null; field, type and value stand in `nonconforming`."""

    class Nonconforming(ScriptedParallel):
        def step(self, actions: Any) -> Any:
            parts = dict(
                zip(
                    ("observations", "rewards", "terminations", "truncations", "infos"),
                    super().step(actions),
                    strict=True,
                )
            )
            parts[part][A] = value
            return tuple(parts.values())

    wrapped, sink = recorded(Nonconforming([Turn()]))
    play_parallel(wrapped, 1)
    first, closing = evidence_of(wrapped, sink).episode(0).turns
    assert closing.nonconforming[A][field]["type"] == type_name
    assert type(closing.nonconforming[A][field]["value"]) is type(value)
    assert np.array_equal(closing.nonconforming[A][field]["value"], value)
    if field == "cumulative_reward":
        assert first.nonconforming[A]["reward"]["type"] == type_name
        assert A not in first.rewards
    if field == "obs":
        assert np.array_equal(closing.observations[A], value)


def test_raise_is_told_and_the_same_decision_stands_again() -> None:
    """Rows of the raising turn name the exception; the next turn was given the same."""
    episode = episode_of([Turn(), Turn(raises=True), Turn()], 3)
    _, raised, again, closing = episode.turns
    name = f"{ScriptError.__module__}.{ScriptError.__name__}"
    assert dict.fromkeys((A, B, C), name) == dict(raised.raised)
    assert raised.rewards == {}
    for agent in (A, B, C):
        assert raised.observations[agent].tolist() == again.observations[agent].tolist()
    assert again.order == (A, B, C)
    assert closing.order == ()
    assert episode.header["end"] == "cut"


def test_raise_that_nobody_plays_on_from_ends_the_episode_as_failed() -> None:
    """The traceback is kept with the episode."""
    wrapped, sink = recorded(ScriptedParallel([Turn(raises=True)]))
    wrapped.reset(seed=1)
    with pytest.raises(ScriptError):
        wrapped.step({})
    header = evidence_of(wrapped, sink).episode_table.to_pylist()[0]
    assert header["end"] == "failed"
    assert "ScriptError: at 1" in header["error"]


def test_raise_in_reset_is_an_episode_without_turns() -> None:
    """The next reset starts the next episode, and nothing of the last one is in it."""

    class Reluctant(ScriptedParallel):
        def reset(self, seed: Any = None, options: Any = None) -> Any:
            if seed == 2:
                raise ScriptError("no")
            return super().reset(seed, options)

    wrapped, sink = recorded(Reluctant([Turn()]))
    play_parallel(wrapped, 2)
    with pytest.raises(ScriptError):
        wrapped.reset(seed=2)
    play_parallel(wrapped, 2)
    evidence = evidence_of(wrapped, sink)
    assert evidence.episode_table["end"].to_pylist() == ["cut", "failed", "cut"]
    assert evidence.episode(1).steps.num_rows == 0
    prints = evidence.episode_table["fingerprint"].to_pylist()
    assert prints[0] == prints[2]
    assert evidence.episode(1).state(0) is None


@pytest.mark.parametrize("out", [None, ({}, {}), "no", [1, 2, 3, 4, 5]])
def test_step_that_returns_something_else_passes_it_on(out: Any) -> None:
    """Its agents were given nothing, which their rows say."""

    class Other(ScriptedParallel):
        def step(self, actions: Any) -> Any:
            super().step(actions)
            return out

    wrapped, sink = recorded(Other([Turn()]))
    wrapped.reset(seed=1)
    assert wrapped.step(dict.fromkeys(wrapped.agents, np.int64(0))) is out
    closing = evidence_of(wrapped, sink).episode(0).turns[-1]
    assert closing.nonconforming[A]["obs"]["type"] in ("missing", "int", "str")


def test_reset_that_returns_no_pair_passes_it_on() -> None:
    """With and without a recorder."""

    class Old(ScriptedParallel):
        def reset(self, seed: Any = None, options: Any = None) -> Any:
            return super().reset(seed, options)[0]

    wrapped, sink = recorded(Old([Turn()]))
    assert set(NAMES[:3]) == set(wrapped.reset(seed=1))
    assert set(evidence_of(wrapped, sink).episode(0).steps["agent"].to_pylist()) == set(NAMES[:3])
    import copy

    assert set(NAMES[:3]) == set(copy.deepcopy(wrapped).reset(seed=1))


def test_action_of_another_whole_type_keeps_value_and_type() -> None:
    """Int after numpy.int64 and the other way round: the column has the value, odd the type."""
    wrapped, sink = recorded(ScriptedParallel([Turn()], n=1))
    for first, second in ((1, np.int64(2)), (np.int64(1), 2)):
        wrapped.reset(seed=1)
        for action in (first, second, first, 2**70, "left", ACTIONS):
            wrapped.step({A: action})
    evidence = evidence_of(wrapped, sink)
    for episode, kinds in enumerate(([int, np.int64, int], [np.int64, int, np.int64])):
        episode = evidence.episode(episode)
        turns = list(episode.turns)
        assert kinds == [type(turn.actions[A]) for turn in turns[:3]]
        assert [turn.actions[A] for turn in turns[:3]] == [1, 2, 1]
        assert episode.steps["action"].to_pylist() == [1, 2, 1, None, None, None, None]
        assert turns[3].actions[A] == 2**70
        assert turns[4].actions[A] == "left"
        assert turns[5].nonconforming[A]["action"]["type"].endswith("Discrete")


def test_seeds_that_no_column_holds_are_refused_before_the_reset() -> None:
    """A seed that can't be handed over again would make a recording that lies."""
    env = ScriptedParallel([Turn()])
    wrapped, sink = recorded(env)
    with pytest.raises(ValueError, match="seed can't be recorded"):
        wrapped.reset(seed=1 << 64)
    with pytest.raises(ValueError, match="seed can't be recorded"):
        wrapped.reset(seed="one")
    assert env.calls == []
    wrapped.reset(seed=np.int32(7))
    wrapped.reset()
    episodes = evidence_of(wrapped, sink).episode_table
    assert episodes["seed"].to_pylist() == [7, None]
    assert episodes["since"].to_pylist() == [0, 0]


@few
@given(st.lists(st.integers(0, 3), max_size=3), st.booleans())
def test_interrupt_amid_the_books_loses_no_row(where: list[int], resumes: bool) -> None:
    """Ctrl-C inside the books loses no row: the turn is booked by whoever comes next."""
    env = ScriptedParallel([Turn(pays=((0, 1.0),))])
    wrapped, sink = recorded(env)
    capture = wrapped._capture
    wrapped.reset(seed=1)
    actions = {agent: np.int64(1) for agent in (A, B, C)}
    for place in where:
        with pytest.raises(KeyboardInterrupt):
            interrupted(capture, place, lambda: wrapped.step(actions))
        if resumes:
            wrapped.step(actions)
    evidence = evidence_of(wrapped, sink)
    episode = evidence.episode(0)
    turns = list(episode.turns)
    assert env.turn + 1 == len(turns)
    assert all(turn.agents == (A, B, C) for turn in turns)
    assert (paid_in(evidence)[A] or 0.0) == env.turn
    assert [float(turn.index) for turn in turns] == [t.observations[A][0] for t in turns]
    assert sink.buffer.given == sink.buffer.done == []


def interrupted(capture: Any, place: int, call: Any) -> None:
    """Makes `call` with Ctrl-C after (or amid) one of the steps of the game's books."""
    name = ("_pay", "_commit", "_stepped", "_give")[place]
    whole = getattr(capture, name)

    def stop(*args: Any) -> None:
        if name == "_commit":  # rows are on the buffer, their mark isn't
            capture._buffer.given.extend(args[0])
        else:
            whole(*args)
        raise KeyboardInterrupt

    setattr(capture, name, stop)
    try:
        call()
    finally:
        delattr(capture, name)
