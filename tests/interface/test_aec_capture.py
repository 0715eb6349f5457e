"""Rows of AEC environments: one for who acted, others for who was paid or changed."""

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pettingzoo.utils import wrappers

from gamekeeper.episodes.episode import Episode
from tests.interface.capture_games import (
    NAMES,
    SCRIPTS,
    ScriptedAEC,
    ScriptError,
    Turn,
    evidence_of,
    play_aec,
    recorded,
)

A, B, C = NAMES[:3]
few = settings(max_examples=40)


def episode_of(script: list[Turn], turns: int, n: int = 3) -> Episode:
    """The episode of an episode played from a script."""
    wrapped, sink = recorded(ScriptedAEC(script, n))
    play_aec(wrapped, turns)
    return evidence_of(wrapped, sink).episode(0)


@few
@given(SCRIPTS)
def test_rows_pay_each_agent_what_every_step_did(script: list[Turn]) -> None:
    """The sum of rewards over rows is the sum of `rewards` after each step, for everybody."""
    wrapped, sink = recorded(ScriptedAEC(script))
    told = play_aec(wrapped, 20)
    steps = evidence_of(wrapped, sink).agent_steps
    table = steps.group_by("agent").aggregate([("reward", "sum")]).to_pydict()
    paid = dict(zip(table["agent"], table["reward_sum"], strict=True))
    for agent, amounts in told.paid.items():
        assert float(sum(map(float, amounts))) == pytest.approx(paid.get(agent) or 0.0, abs=1e-6)


@few
@given(SCRIPTS)
def test_row_of_who_acts_is_what_last_returned(script: list[Turn]) -> None:
    """Observation, received reward, flags and info of every turn, in the order of turns."""
    env = ScriptedAEC(script)
    wrapped, sink = recorded(env)
    wrapped.reset(seed=1)
    seen: list[Any] = []
    for turn in range(20):
        if not wrapped.agents:
            break
        agent = wrapped.agent_selection
        observation, cumulative_reward, terminated, truncated, info = wrapped.last()
        seen.append(
            (agent, observation.tolist(), cumulative_reward, terminated, truncated, sorted(info))
        )
        live = agent in wrapped.agents
        with contextlib.suppress(ScriptError):
            wrapped.step(None if terminated or truncated else np.int64(turn % 3))
        assert live
    turns = list(evidence_of(wrapped, sink).episode(0).turns)
    for turn, (agent, observation, cumulative_reward, terminated, truncated, info) in zip(
        turns, seen, strict=False
    ):
        assert turn.order == (agent,)
        assert observation == turn.observations[agent].tolist()
        assert cumulative_reward == turn.cumulative_reward[agent]
        assert (terminated, truncated) == (turn.terminated[agent], turn.truncated[agent])
        assert info == sorted(turn.infos[agent])
        assert agent in turn.live
        assert set(turn.observations) == {agent}
    assert len(seen) <= len(turns) <= len(seen) + 1


@few
@given(SCRIPTS)
def test_roster_can_be_followed_from_rows_alone(script: list[Turn]) -> None:
    """Turn 0 lists the roster; whoever joins, leaves or ends has a row at the turn that follows."""
    wrapped, sink = recorded(ScriptedAEC(script))
    wrapped.reset(seed=1)
    rosters = [set(wrapped.agents)]
    for turn in range(20):
        if not wrapped.agents:
            break
        over = any(wrapped.last()[2:4])
        with contextlib.suppress(ScriptError):
            wrapped.step(None if over else np.int64(turn % 3))
        rosters.append(set(wrapped.agents))
    known: set[Any] = set()
    for turn in evidence_of(wrapped, sink).episode(0).turns:
        for agent in turn.agents:
            (known.add if agent in turn.live else known.discard)(agent)
        assert known == rosters[turn.index]
        gone = [a for a in turn.order if turn.terminated.get(a) or turn.truncated.get(a)]
        known -= set(gone) if not turn.raised else set()


def test_rows_stand_only_for_who_acted_was_paid_or_changed() -> None:
    """Turn 0 lists everybody; then only those with something to say."""
    script = [Turn(), Turn(pays=((0, 2.0),)), Turn(ends=((0, True),)), Turn()]
    turns = list(episode_of(script, 4).turns)
    assert [(*turn.order, *sorted(set(turn.agents) - set(turn.order))) for turn in turns] == [
        (A, B, C),
        (B, A),
        (C,),
        (A,),
    ]
    assert turns[1].rewards == {B: 0.0, A: 2.0}
    assert turns[1].cumulative_reward == {B: 0.0}
    assert turns[3].cumulative_reward == {A: 2.0}
    assert turns[3].terminated == {A: True}
    assert dict(turns[3].actions) == {}
    assert A not in turns[3].rewards  # its books are gone with it


def test_agent_that_leaves_without_a_word_has_a_row() -> None:
    """Its flags are False and it isn't live; who ends by its own last turn needs none."""
    turns = list(episode_of([Turn(leaves=(1,)), Turn()], 3).turns)
    assert B in turns[1].agents
    assert B not in turns[1].live
    assert turns[1].terminated[B] is False


def test_newcomers_have_a_row_at_the_turn_that_follows() -> None:
    """Announced or not."""
    turns = list(episode_of([Turn(joins=2), Turn()], 3).turns)
    assert {NAMES[3], NAMES[4]} <= set(turns[1].agents)
    assert {NAMES[3], NAMES[4]} <= turns[1].live
    assert turns[1].cumulative_reward == {B: 0.0}


def test_end_of_everybody_is_an_end_whether_or_not_the_dead_step() -> None:
    """All flags set: ended, both with the None turns played and without; else cut."""
    everybody = Turn(ends=((0, True), (1, True), (2, False)))
    assert episode_of([everybody], 1).header["end"] == "ended"
    assert episode_of([everybody], 9).header["end"] == "ended"
    assert episode_of([Turn(ends=((0, True),))], 1).header["end"] == "cut"


def test_look_without_a_step_is_a_closing_row() -> None:
    """What was given last, and not acted on, stands in the last turn."""
    wrapped, sink = recorded(ScriptedAEC([Turn()]))
    wrapped.reset(seed=1)
    wrapped.last()
    wrapped.step(np.int64(0))
    wrapped.last()
    closing = evidence_of(wrapped, sink).episode(0).turns[-1]
    assert closing.agents == (B,)
    assert closing.order == ()
    assert closing.observations[B].tolist() == [1.0, 1.0]


def test_last_look_of_a_turn_counts() -> None:
    """Several looks, of the agent in turn and of others: one observation in its row."""

    class Blink(ScriptedAEC):
        looks = 0

        def observe(self, agent: str) -> Any:
            self.looks += 1
            return np.array([self.looks, 0], np.float32)

    wrapped, sink = recorded(Blink([Turn()]))
    wrapped.reset(seed=1)
    for agent in (A, B, A, C):
        wrapped.observe(agent)
    wrapped.step(np.int64(0))
    wrapped.step(np.int64(0))
    first, second = evidence_of(wrapped, sink).episode(0).turns
    assert {k: v.tolist() for k, v in first.observations.items()} == {A: [3.0, 0.0]}
    assert dict(second.observations) == {}
    assert second.cumulative_reward == {B: 0.0}


def test_raise_is_told_and_the_same_decision_stands_again() -> None:
    """Its row names the exception; the agent in turn acts again at the next."""
    episode = episode_of([Turn(raises=True), Turn()], 2)
    raised, again = episode.turns
    assert raised.live == {A, B, C}
    assert {A: f"{ScriptError.__module__}.{ScriptError.__name__}"} == dict(raised.raised)
    assert raised.order == again.order == (A,)
    assert again.cumulative_reward == {A: 0.0}
    assert episode.header["end"] == "cut"


class Bare(ScriptedAEC):
    """An environment whose books a test writes into after each step."""

    def __init__(self, write: Callable[[Any], None]) -> None:
        super().__init__([Turn()])
        self.write = write

    def step(self, action: Any) -> None:
        super().step(action)
        self.write(self)


@pytest.mark.parametrize(
    ("book", "field", "value", "type_name"),
    [
        ("_cumulative_rewards", "cumulative_reward", None, "NoneType"),
        ("_cumulative_rewards", "cumulative_reward", "x", "str"),
        ("_cumulative_rewards", "cumulative_reward", np.int64(2**60), "numpy.int64"),
        ("_cumulative_rewards", "cumulative_reward", np.array([1.0, 2.0]), "numpy.ndarray"),
        ("terminations", "terminated", 0, "int"),
        ("truncations", "truncated", None, "NoneType"),
        ("infos", "info", None, "NoneType"),
        ("infos", "info", ["a"], "list"),
    ],
)
def test_value_that_does_not_conform_is_kept_as_it_was(
    book: str, field: str, value: Any, type_name: str
) -> None:
    """What the agent in turn was given stands in `nonconforming` with its type."""
    wrapped, sink = recorded(Bare(lambda env: getattr(env, book).update({B: value})))
    wrapped.reset(seed=1)
    wrapped.step(np.int64(0))
    wrapped.step(np.int64(0))
    turn = evidence_of(wrapped, sink).episode(0).turns[1]
    assert turn.nonconforming[B][field]["type"] == type_name
    assert np.array_equal(turn.nonconforming[B][field]["value"], value)


@pytest.mark.parametrize("value", [None, "x", True, np.array([1.0, 2.0]), np.uint64(2**63)])
def test_payment_that_is_no_number_is_kept_as_it_was(value: Any) -> None:
    """The actor's and others'; columns stay null."""

    def pay(env: Any) -> None:
        env.rewards[A] = env.rewards[C] = value

    wrapped, sink = recorded(Bare(pay))
    wrapped.reset(seed=1)
    wrapped.step(np.int64(0))
    turn = evidence_of(wrapped, sink).episode(0).turns[0]
    for agent in (A, C):
        assert turn.nonconforming[agent]["reward"]["type"] in (
            type(value).__name__,
            "numpy.ndarray",
            "numpy.uint64",
        )
        assert agent not in turn.rewards


@pytest.mark.parametrize("book", ["_cumulative_rewards", "terminations", "truncations", "infos"])
def test_book_that_lacks_the_agent_is_nonconforming_and_stops_nothing(book: str) -> None:
    """Its type is `missing`."""
    wrapped, sink = recorded(Bare(lambda env: getattr(env, book).pop(B)))
    wrapped.reset(seed=1)
    wrapped.step(np.int64(0))
    with pytest.raises(KeyError):  # the environment's own
        wrapped.last()
    with contextlib.suppress(KeyError):  # of the environment too, but for its infos
        wrapped.step(np.int64(0))
    turn = evidence_of(wrapped, sink).episode(0).turns[1]
    assert list(turn.nonconforming[B].values()) == [{"type": "missing"}]


def test_flag_that_is_an_array_is_nonconforming_and_stops_nothing() -> None:
    """An array of flags has no truth; rows say what it was, at the turn after and at its own."""

    class Blind(ScriptedAEC):
        def step(self, action: Any) -> None:
            self.calls.append("step")
            self.terminations[C] = np.array([False, True])
            self.agent_selection = NAMES[(NAMES.index(self.agent_selection) + 1) % 3]

    wrapped, sink = recorded(Blind([Turn()]))
    wrapped.reset(seed=1)
    for _ in range(4):
        wrapped.last()
        wrapped.step(np.int64(0))
    turns = list(evidence_of(wrapped, sink).episode(0).turns)
    for turn in (turns[1], turns[2]):
        assert turn.nonconforming[C]["terminated"]["type"] == "numpy.ndarray"
        assert C not in turn.terminated


def test_books_behind_wrappers_are_read_where_they_are_kept() -> None:
    """Through PettingZoo's stack the rows are the same, and nothing falls through `__getattr__`."""
    prints = []
    for wrap in (False, True):
        env: Any = ScriptedAEC([Turn(pays=((1, 1.0),)), Turn(ends=((0, True),))])
        if wrap:
            env = wrappers.OrderEnforcingWrapper(wrappers.AssertOutOfBoundsWrapper(env))
        wrapped, sink = recorded(env)
        wrapped.reset(seed=1)
        for _ in wrapped.agent_iter(12):
            over = any(wrapped.last()[2:4])
            wrapped.step(None if over else 1)
        prints.append(evidence_of(wrapped, sink).episode_table["fingerprint"].to_pylist())
    assert prints[0] == prints[1]


def test_illegal_move_that_a_wrapper_ends_is_in_the_rows() -> None:
    """TerminateIllegalWrapper writes new books into the environment; flags and penalty are seen."""

    class Masked(ScriptedAEC):
        def observe(self, agent: str) -> Any:
            return {"observation": self.look(agent), "action_mask": np.array([0, 1, 1], np.int8)}

    env = wrappers.TerminateIllegalWrapper(Masked([Turn()]), illegal_reward=-1)
    wrapped, sink = recorded(env)
    wrapped.reset(seed=1)
    wrapped.last()
    wrapped.step(0)
    while wrapped.agents:
        wrapped.last()
        wrapped.step(None)
    evidence = evidence_of(wrapped, sink)
    turns = list(evidence.episode(0).turns)
    assert turns[0].rewards == {A: -1.0}
    assert turns[1].terminated == {A: True, B: True, C: True}
    assert evidence.episode_table["end"].to_pylist() == ["ended"]


def test_interrupt_in_the_environments_step_leaves_what_was_given() -> None:
    """Ctrl-C amid a step, its books half written: the episode is cut before that step."""

    class Slow(ScriptedAEC):
        def step(self, action: Any) -> None:
            if self.turn == 1:
                self._cumulative_rewards[self.agent_selection] = 99
                raise KeyboardInterrupt
            super().step(action)

    prints = []
    for cls in (ScriptedAEC, Slow):
        wrapped, sink = recorded(cls([Turn(pays=((1, 2.0),))]))
        wrapped.reset(seed=1)
        wrapped.last()
        wrapped.step(np.int64(0))
        wrapped.last()
        if cls is Slow:
            with pytest.raises(KeyboardInterrupt):
                wrapped.step(np.int64(0))
        evidence = evidence_of(wrapped, sink)
        prints.append(evidence.fingerprint)
    assert prints[0] == prints[1]
    assert evidence.episode(0).turns[-1].cumulative_reward == {B: 2.0}


@few
@given(st.lists(st.integers(0, 3), max_size=3), st.booleans())
def test_interrupt_amid_the_books_loses_no_row(where: list[int], resumes: bool) -> None:
    """Ctrl-C inside the books: the turn is booked by whoever comes next."""
    env = ScriptedAEC([Turn(pays=((0, 1.0),)), Turn(ends=((1, True),)), Turn(joins=1)], n=4)
    whole = ScriptedAEC(env.script, n=4)
    prints = []
    for game_env, places in ((env, where), (whole, None)):
        wrapped, sink = recorded(game_env)
        capture = wrapped._capture
        wrapped.reset(seed=1)
        for at in range(6):
            if not wrapped.agents:
                break
            over = any(wrapped.last()[2:4])
            action = None if over else np.int64(1)
            if places is None or at >= len(places):
                wrapped.step(action)
            else:
                with pytest.raises(KeyboardInterrupt):
                    interrupted(capture, places[at], action)
            if resumes:
                wrapped.last()
        evidence = evidence_of(wrapped, sink)
        prints.append(evidence.episode_table["fingerprint"].to_pylist())
        assert sink.buffer.given == sink.buffer.done == []
    assert prints[0] == prints[1]


def interrupted(capture: Any, place: int, action: Any) -> None:
    """Steps with Ctrl-C after (or amid) one of the parts of the game's books."""
    name = ("_pay", "_commit", "_stepped", "_note")[place]
    whole = getattr(capture, name)

    def stop(*args: Any) -> None:
        if name == "_commit":  # rows are on the buffer, their mark isn't
            capture._buffer.given.extend(args[0])
        else:
            whole(*args)
        raise KeyboardInterrupt

    setattr(capture, name, stop)
    try:
        capture.step(action)
    finally:
        delattr(capture, name)
