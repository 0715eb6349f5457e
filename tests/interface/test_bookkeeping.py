"""The AEC books keep what PettingZoo promises, whatever is played."""

import copy
import pickle
from collections.abc import Hashable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.errors import ActionError, ContractError, OrderError
from gamekeeper.interface.bookkeeping import Circle
from gamekeeper.interface.turn_env import TurnEnv
from tests.interface.scripted import SCRIPTS, Documented, OnBase, OnBaseChoosing, Play, same_number

QUIET = Play((), (), 0, None)


def step_once(env: Any) -> None:
    """One turn, with the action that `last` asks for."""
    _, _, terminated, truncated, _ = env.last()
    env.step(None if terminated or truncated else 1)


def over(env: Any) -> bool:
    """Whether the script has been played."""
    played = env.turn if isinstance(env, Documented) else env.turns
    return played == len(env.script)


def assert_same_books(base: OnBase, documented: Documented) -> None:
    """Every public book is the same, and a plain dictionary or list."""
    assert documented.agents == base.agents
    for name in ("rewards", "_cumulative_rewards"):
        ours, theirs = getattr(base, name), getattr(documented, name)
        assert type(ours) is dict
        assert list(theirs) == list(ours)
        assert all(same_number(theirs[agent], ours[agent]) for agent in theirs)
    for name in ("terminations", "truncations", "infos"):
        assert list(getattr(documented, name).items()) == list(getattr(base, name).items())
    if base.agents:
        assert documented.agent_selection == base.agent_selection
        assert documented.last()[1:] == base.last()[1:]


@given(st.integers(1, 6), SCRIPTS, st.booleans())
def test_books_equal_the_documented_pattern(n: int, script: list[Play], chooses: bool) -> None:
    """Deaths, joins, repeated turns, any order and payments to anyone: every book, every turn."""
    if not chooses:
        script = [replace(play, then=None) for play in script]
    base, documented = (OnBaseChoosing if chooses else OnBase)(n, script), Documented(n, script)
    for _ in range(2):
        base.reset()
        documented.reset()
        assert_same_books(base, documented)
        while base.agents and not over(base):
            step_once(base)
            step_once(documented)
            assert_same_books(base, documented)


@given(st.integers(1, 6), SCRIPTS)
def test_touched_names_all_that_a_env_step_changed(n: int, script: list[Play]) -> None:
    """Who isn't named by `touched` was neither paid nor ended, and didn't come or go."""
    base = OnBaseChoosing(n, script)
    base.reset()
    while base.agents and not over(base):
        before = {
            agent: base.terminations[agent] or base.truncations[agent] for agent in base.agents
        }
        step_once(base)
        after = {
            agent: base.terminations[agent] or base.truncations[agent] for agent in base.agents
        }
        touched = base.touched
        assert [agent for agent in after if agent not in before] == touched.joined
        assert [agent for agent in before if agent not in after] == touched.left
        assert {agent for agent in after if after[agent] and not before.get(agent)} == set(
            touched.ended
        )
        assert {agent for agent, reward in base.rewards.items() if reward} <= set(touched.paid)
        assert set(touched.ended) <= set(base.endings)


@given(st.integers(1, 5), SCRIPTS, st.integers(0, 12))
def test_copies_of_a_running_environment_go_on_alike(
    n: int, script: list[Play], before: int
) -> None:
    """A deep copy, a pickled one, a restored one and its own past play the same rest."""
    base = OnBaseChoosing(n, script)
    base.reset(seed=3)
    for _ in range(before):
        if base.agents and not over(base):
            step_once(base)
    snapshot = base.snapshot()
    counterfactuals = [
        copy.deepcopy(base),
        pickle.loads(pickle.dumps(base)),
        OnBaseChoosing(n, script),
    ]
    counterfactuals[2].restore(snapshot)
    expected = rest_of(base)
    base.restore(snapshot)
    assert [expected] * 4 == [rest_of(env) for env in (base, *counterfactuals)]


def rest_of(env: OnBase) -> list[Any]:
    """All books from here to the end."""
    seen = []
    while True:
        books = (
            env.agents,
            env.rewards,
            env.terminations,
            env.truncations,
            env.endings,
            env.touched,
        )
        seen.append((env.agent_selection, env.turns, copy.deepcopy(books)))
        if not env.agents or over(env):
            return seen
        step_once(env)


@given(st.data(), st.integers(1, 8))
def test_circle_is_the_roster_joined_end_to_end(data: st.DataObject, n: int) -> None:
    """After any leaving and joining, neighbours, places and positions are those of a list."""
    roster: list[Hashable] = [f"a{i}" for i in range(n)]
    circle, born = Circle(list(roster)), n
    for _ in range(data.draw(st.integers(0, 12))):
        if len(roster) > 1 and data.draw(st.booleans()):
            gone = data.draw(st.sampled_from(roster))
            assert roster.index(gone) == circle.remove(gone)
            roster.remove(gone)
        else:
            circle.append(f"a{born}", roster[-1])
            roster.append(f"a{born}")
            born += 1
        following = dict(zip(roster, roster[1:] + roster[:1], strict=True))
        assert following == circle.after
        assert {after: before for before, after in following.items()} == circle.before
        assert roster == sorted(roster, key=circle.place.__getitem__)


class Free(OnBase):
    """Does in its turn whatever a test tells it to."""

    def __init__(self, n: int = 3) -> None:
        super().__init__(n, [QUIET] * 50)
        self.deed: Any = None

    def act(self, agent: str, action: int) -> None:
        if self.deed is not None:
            self.deed(self)


@pytest.mark.parametrize(
    ("deed", "text"),
    [
        (lambda env: env.add_reward("nobody", 1), "'nobody' was paid and isn't in the roster"),
        (lambda env: env.add_reward("agent_7", 1), "it hasn't joined"),
        (lambda env: env.add_reward("agent_0", float("nan")), "'agent_0' was paid nan"),
        (lambda env: env.add_reward("agent_0", float("inf")), "'agent_0' was paid inf"),
        (lambda env: env.terminate("nobody"), "'nobody' was ended and isn't in the roster"),
        (lambda env: env.join("agent_0"), "'agent_0' joined twice"),
        (lambda env: env.join("nobody"), "isn't in possible_agents"),
    ],
)
def test_verbs_refuse_what_the_books_cannot_keep(deed: Any, text: str) -> None:
    """A rule's mistake is named where it is made."""
    env = Free()
    env.reset()
    env.deed = deed
    with pytest.raises(ContractError, match=text):
        env.step(0)


def test_agent_that_ended_stays_out() -> None:
    """After its last turn an agent is neither paid nor let in again."""
    env = Free()
    env.reset()
    env.deed = lambda env: env.truncate("agent_1", "battery")
    env.step(0)
    env.deed = None
    env.step(None)
    assert env.agents == ["agent_0", "agent_2"]
    for deed, text in [
        (lambda env: env.add_reward("agent_1", 1.0), "it ended before: battery"),
        (lambda env: env.join("agent_1"), "joined after it had ended"),
    ]:
        env.deed = deed
        with pytest.raises(ContractError, match=text):
            env.step(0)


def test_endings_keep_the_first_reason() -> None:
    """Both flags may be set; the reason given first stands, and saying it again changes nothing."""
    env = Free()
    env.reset()

    def deed(env: TurnEnv) -> None:
        env.terminate("agent_2", "met")
        env.terminate("agent_2", "again")
        env.truncate("agent_2", "battery")
        env.truncate("agent_0")

    env.deed = deed
    env.step(0)
    assert env.endings == {"agent_2": "met", "agent_0": "truncated"}
    assert (env.terminations["agent_2"], env.truncations["agent_2"]) == (True, True)
    assert env.agent_selection == "agent_0"


def test_terms_part_the_reward_of_the_last_env_step() -> None:
    """Amounts are kept by agent and term, and cleared with the rewards."""
    env = Free()
    env.reset()

    def deed(env: TurnEnv) -> None:
        env.add_reward("agent_0", 1, term="delivery")
        env.add_reward("agent_0", 0.5, term="delivery")
        env.add_reward("agent_0", -0.25, term="energy")
        env.add_reward("agent_1", 2.0)

    env.deed = deed
    env.step(0)
    assert env.terms == {"agent_0": {"delivery": 1.5, "energy": -0.25}}
    assert env.rewards == {"agent_0": 1.25, "agent_1": 2.0, "agent_2": 0.0}
    env.deed = None
    env.step(0)
    assert env.terms == {}
    assert env.touched.paid == {}
    assert {0.0} == set(env.rewards.values())


@pytest.mark.parametrize("call", ["step", "last", "agent_iter", "observe"])
def test_calls_before_reset_are_refused(call: str) -> None:
    """Before the first reset there is nothing to step or look at, nor a roster."""
    env = Free()
    arguments: dict[str, tuple[Any, ...]] = {"step": (0,), "observe": ("agent_0",)}
    with pytest.raises(OrderError, match=rf"{call}\(\) came before reset"):
        getattr(env, call)(*arguments.get(call, ()))
    with pytest.raises(AttributeError):
        env.agents  # noqa: B018


def test_calls_after_the_end_are_refused() -> None:
    """When everybody has left, step and last ask for a reset; a loop just ends."""
    env = Free(n=1)
    env.reset()
    env.deed = lambda env: env.terminate("agent_0")
    env.step(0)
    env.step(None)
    for _ in range(2):
        with pytest.raises(OrderError, match="after the last agent had left"):
            env.step(None)
        with pytest.raises(OrderError, match="after the last agent had left"):
            env.last()
    assert list(env.agent_iter()) == []
    env.reset()
    assert env.agents == ["agent_0"]


def test_loop_without_a_step_is_refused() -> None:
    """agent_iter notices a round in which nobody stepped; a new loop begins afresh."""
    env = Free()
    env.reset()
    turns = env.agent_iter()
    next(turns)
    with pytest.raises(OrderError, match="without a step"):
        next(turns)
    assert list(env.agent_iter(1)) == ["agent_0"]
    steps = 0
    for _ in env.agent_iter(4):
        env.step(0)
        steps += 1
    assert steps == 4


def test_ended_agent_can_only_do_nothing() -> None:
    """An action of an agent that has ended is refused, and it may still take its last turn."""
    env = Free()
    env.reset()
    env.deed = lambda env: env.terminate("agent_0")
    env.step(0)
    with pytest.raises(ActionError, match="'agent_0' acted after it had ended"):
        env.step(0)
    env.step(None)
    assert env.agent_selection == "agent_1"


class Nonconforming(OnBase):
    """Begins as a test tells it to."""

    def __init__(self, roster: list[str], first: Any = None) -> None:
        super().__init__(2, [QUIET])
        self.roster, self.first, self.deed = roster, first, None

    def starting_agents(self) -> list[str]:
        return self.roster

    def first_agent(self) -> Any:
        return self.first or self.agents[0]

    def start(self, rng: Any, options: Any) -> None:
        if self.deed is not None:
            self.deed(self)  # type: ignore[unreachable]  # set by a test


@pytest.mark.parametrize("roster", [[], ["agent_0", "agent_0"], ["agent_0", "nobody"]])
def test_episode_with_a_wrong_roster_is_refused(roster: list[str]) -> None:
    """A roster is one or more possible agents, each once."""
    with pytest.raises(ContractError, match="can't begin with this roster"):
        Nonconforming(roster).reset()


def test_episode_begins_with_whom_the_author_says() -> None:
    """The first agent is the author's choice, of those in the roster."""
    env = Nonconforming(["agent_0", "agent_1"], "agent_1")
    env.reset()
    assert env.agent_selection == "agent_1"
    with pytest.raises(ContractError, match="given the first turn"):
        Nonconforming(["agent_0"], "agent_1").reset()


@pytest.mark.parametrize(
    ("deed", "text"),
    [
        (lambda env: env.add_reward("agent_0", 1.0), "paid before anybody acted"),
        (lambda env: env.truncate("agent_0"), "ended before anybody acted"),
    ],
)
def test_first_state_pays_and_ends_nobody(deed: Any, text: str) -> None:
    """After a reset all rewards are 0 and all flags False."""
    env = Nonconforming(["agent_0"])
    env.deed = deed
    with pytest.raises(ContractError, match=text):
        env.reset()


def test_order_of_turns_is_not_asked_once_all_have_ended() -> None:
    """A next_agent that looks for somebody alive needn't think of the turn that ended everybody."""

    class Last(Free):
        def next_agent(self, agent: str) -> str:
            return next(each for each in self.agents if each not in self.endings)

    env = Last()
    env.reset()
    env.step(0)
    env.deed = lambda env: [env.terminate(each) for each in env.agents]
    env.step(0)
    assert [step_once(env) for _ in range(3)] == [None] * 3
    assert env.agents == []


def test_turn_given_to_an_absent_agent_is_refused() -> None:
    """next_agent must name somebody in the roster."""

    class Lost(OnBase):
        def next_agent(self, agent: str) -> str:
            return "agent_9"

    env = Lost(2, [QUIET])
    env.reset()
    with pytest.raises(ContractError, match="given a turn by next_agent"):
        env.step(0)
