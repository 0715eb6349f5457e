"""Messages between agents: they are found, delivered, and never blamed on one agent alone."""

from collections import deque
from typing import Any, ClassVar

import numpy as np
import pytest
from gymnasium.spaces import Discrete, MultiDiscrete

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.diagnosis.judgement import ScopeFinding, judged
from gamekeeper.diagnosis.message_channels import (
    MessageChannel,
    _is_passed_on,
    between,
    channels_of,
    deliveries,
    sound_ways,
)
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.diagnosis.trials import POLICY, IdealSubstitute, over_undos, undone
from gamekeeper.diagnosis.undos import BoundaryUndo

WORDS = 5


class Post(gk.TickEnv):
    """A writer sees a number and says it; a reader has to repeat what it was told."""

    metadata = {"name": "post_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it
    late: ClassVar[int] = 0

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.possible_agents = ["writer", "reader"]
        self.observation_spaces = {a: MultiDiscrete([WORDS, 9]) for a in self.possible_agents}
        self.action_spaces = {a: Discrete(WORDS) for a in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Draws the number."""
        self.rng, self.turn = rng, 0
        self.number = int(rng.integers(1, WORDS))
        self.way = deque([0] * self.late)

    def tick(self, actions: Any) -> None:
        """The word arrives, at once or late; after nine ticks it is over."""
        self.turn += 1
        self.way.append(int(actions["writer"]))
        self.heard = self.way.popleft()
        right = int(actions["reader"]) == self.number
        for agent in self.possible_agents:
            self.add_reward(agent, float(right))
            if right or self.turn == 9:
                self.terminate(agent, "over")

    def observe(self, agent: str) -> list[int]:
        """The number for the writer, what was heard for the reader, and the turn."""
        first = self.number if agent == "writer" else getattr(self, "heard", 0)
        return [first, min(self.turn, 8)]


class LatePost(Post):
    """The same, with words that arrive three ticks late."""

    late = 3


@pytest.mark.parametrize(("env", "lag"), [(Post, 0), (LatePost, 3)])
def test_a_field_that_follows_what_another_agent_does_is_a_message(env: Any, lag: int) -> None:
    """Whole, and as late as it is; what follows nobody's action is none."""
    setup = Setup(env, policies={"*": "first-legal"})
    (found,) = channels_of(setup, Contract(), ("writer", "reader"), seed=0)
    assert found == MessageChannel("writer", "reader", (0,), (0,), is_equal=True, lag=lag)
    late = deliveries([found])
    assert [str(each) for each in late] == ["giving reader what writer said last"][: lag > 0]


def test_what_is_only_passed_on_is_no_message_of_the_first_speaker() -> None:
    """Nor is a word that nobody else could have passed on."""
    first, second = MessageChannel("a", "b", (0,), (0,)), MessageChannel("b", "c", (0,), (0,))
    relayed = MessageChannel("a", "c", (0,), (0,))
    assert [_is_passed_on(one, [first, second, relayed]) for one in (first, second, relayed)] == [
        False,
        False,
        True,
    ]


def test_an_undo_of_messages_alone_is_told_from_one_of_anything_else() -> None:
    """Of their speaker and those that hear them; what touches another field too is none."""
    channels = [MessageChannel("x", to, (0, 1), (2, 3)) for to in ("y", "z")]
    axes = {"x": 2, "y": 1}

    def ends(agent: str, way: Any, *places: int) -> tuple[str, ...]:
        return between(BoundaryUndo((agent,), way, places), channels, axes)

    assert ends("y", "exchange fields", 2, 3) == ("x", "y")
    assert ends("y", "exchange fields", 1, 2) == ()
    assert ends("y", "exchange values", 2, 7, 8) == ("x", "y")
    assert ends("y", "mirror axis", 0) == ()
    assert ends("x", "mirror axis", 1) == ("x", "y", "z")
    assert ends("x", "rescale axes") == ("x", "y", "z")
    assert between(BoundaryUndo(("x",), "rescale axes"), channels, {"x": 3}) == ()
    assert ends("y", "hold") == ()
    lossy = [MessageChannel("x", "y", (0,), (2,), is_whole=False)]
    assert between(BoundaryUndo(("y",), "hold", amount=4.0), lossy, axes) == ("x", "y")
    late = [MessageChannel("x", "y", (0,), (2,), lag=lag) for lag in (1, 2)]
    assert between(BoundaryUndo(("y",), "settle", amount=8.0), late[:1], axes) == ()
    assert between(BoundaryUndo(("y",), "settle", amount=8.0), late, axes) == ("x", "y")


def test_what_arrives_as_it_was_said_is_sound() -> None:
    """Between two agents: all of it, at once or by the next decision."""
    channels = [
        MessageChannel("x", "y", (0,), (2,), is_equal=True, lag=1),
        MessageChannel("x", "z", (0,), (2,), is_equal=True),
        MessageChannel("x", "z", (1,), (3,)),
        MessageChannel("y", "z", (0,), (1,), is_equal=True, lag=2),
    ]
    assert sound_ways(channels) == {("x", "y")}


def answer(*substitutes: IdealSubstitute) -> ScopeFinding:
    """The finding where each of these restores all."""
    arms = {one: np.ones(64) for one in over_undos(substitutes)}
    return judged(np.zeros(64), arms, rng=np.random.default_rng(0))


HEARD = undone(BoundaryUndo(("y",), "mirror field", (2,)), between=("x", "y"))
SAID = undone(BoundaryUndo(("x",), "mirror axis", (0,)), between=("x", "y"))
PEER = IdealSubstitute("policy[x] = w's", POLICY, ("x",), (("policies", "x", "", "w"),))


def test_messages_are_named_where_speaker_and_listener_cannot_be_told_apart() -> None:
    """One that misreads them looks as one that says them wrongly: neither alone, and no label."""
    for found in (answer(HEARD), answer(SAID), answer(HEARD, SAID)):
        assert (found.answer, found.labels) == ("ambiguous", ())
        assert {a for one in found.substitutes for a in one.concerned} == {"x", "y"}
        assert "messages from x to y" in found.why


def test_a_policy_of_a_peer_tells_speaker_and_listener_apart() -> None:
    """The reader gets along with another writer: then it is the writer's."""
    found = answer(HEARD, SAID, PEER)
    assert found.answer == "isolated"
    assert (found.substitutes[0].agents, found.labels) == (("x",), ("control",))


class Copyist:
    """Says what it sees first."""

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        """The action."""
        return int(observation[0])


def test_messages_that_arrive_late_are_nobodys_own() -> None:
    """Both do well once words arrive as they were said."""
    policies = {"*": Copyist()}
    evidence = gk.rollout(LatePost, policies=policies, episodes=4, seed=1)
    found = gk.diagnose(
        evidence, env=LatePost, policies=policies, failed="length > 3", episodes=300
    )
    assert found.team is not None
    assert (found.team.answer, found.team.labels) == ("environment", ())
    assert found.team.component == "messages from writer to reader, late or lost on their way"
