"""Checks of spaces, observations and what `step` takes, where the matrix doesn't go."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from pettingzoo import ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from tests.faults.other_agents import LimitOfTheOneInTurn
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders

FAMILY = ("GK20", "GK21", "GK22")
CARDS = 40


class Sampler(ParallelEnv[Any, Any, Any]):
    """Agents 0 and 1 observe samples of any space for six ticks."""

    metadata = {"name": "sampler_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it
    render_mode = None

    def __init__(self, seen: spaces.Space[Any], done: spaces.Space[Any], agents: Any) -> None:
        self.possible_agents = list(agents)
        self.agents: list[Any] = []
        self._seen = {agent: copy.deepcopy(seen) for agent in agents}
        self._done = {agent: copy.deepcopy(done) for agent in agents}
        self._own = copy.deepcopy(seen)

    def observation_space(self, agent: Any) -> spaces.Space[Any]:
        return self._seen[agent]

    def action_space(self, agent: Any) -> spaces.Space[Any]:
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self._own.seed(seed)
        self.agents, self.time = list(self.possible_agents), 0
        return {a: self.give(a) for a in self.agents}, {a: {} for a in self.agents}

    def give(self, agent: Any) -> Any:
        return self._own.sample()

    def step(self, actions: dict[Any, Any]) -> Any:
        acting, self.time = self.agents, self.time + 1
        assert all(self._done[a].contains(actions[a]) for a in acting)
        if self.time >= 6:
            self.agents = []
        late = self.time >= 6
        return (
            {a: self.give(a) for a in acting},
            dict.fromkeys(acting, 0.0),
            dict.fromkeys(acting, False),
            dict.fromkeys(acting, late),
            {a: {} for a in acting},
        )


def audited(make: Callable[[], Any] | Any, *select: str, budget: int = 150) -> AuditResult:
    """The audit of an environment, by some checks."""
    return audit_here(make, select=select or FAMILY, budget=budget)


def broken(audit: AuditResult) -> list[str]:
    """Ids of what was broken; an error of a check counts too."""
    return [each.id for each in audit.verdicts if each.outcome in ("failed", "error")]


ANY = [
    (spaces.Text(6), spaces.Discrete(3, start=5)),
    (spaces.Sequence(spaces.Discrete(4)), spaces.MultiDiscrete([3, 2])),
    (spaces.Graph(spaces.Box(0, 1, (2,), np.float32), spaces.Discrete(3)), spaces.MultiBinary(3)),
    (
        spaces.OneOf((spaces.Discrete(2), spaces.Box(0, 1, (2,), np.float32))),
        spaces.Dict(move=spaces.Discrete(3), push=spaces.Box(-1, 1, (2,), np.float32)),
    ),
    (
        spaces.Tuple((spaces.Discrete(3), spaces.Text(3))),
        spaces.Tuple((spaces.Discrete(2), spaces.Box(-np.inf, np.inf, (1,), np.float32))),
    ),
    (spaces.Box(-np.inf, np.inf, (2,), np.float64), spaces.Box(0, 255, (2,), np.uint8)),
]


@pytest.mark.parametrize(("seen", "done"), ANY, ids=lambda space: type(space).__name__)
def test_spaces_of_any_kind_are_kept(seen: spaces.Space[Any], done: spaces.Space[Any]) -> None:
    """No kind of space is a fault, for agents whose names are no text."""
    assert broken(audited(lambda: Sampler(seen, done, (0, 1)))) == []


def test_spaces_of_turns_are_kept() -> None:
    """Who isn't in turn is observed too, in an environment of numbered agents."""
    assert broken(audited(lambda: parallel_to_aec(Sampler(*ANY[0], (0, 1))))) == []


def test_dtype_that_is_wrong_at_every_turn_is_told_once() -> None:
    """Agents out of turn observe what is wrong in their own turns: one verdict."""

    class Doubles(Traders):
        def observe(self, agent: str) -> Any:
            return np.asarray(super().observe(agent), np.float64)

    assert broken(audited(Doubles)) == ["GK212"]


class Arrays(Sampler):
    """Observes an array of whole numbers, then of others, where one number is declared."""

    def give(self, agent: Any) -> Any:
        return np.zeros(3, np.float64 if self.time else np.int64)


def test_array_in_place_of_a_number_is_told_once() -> None:
    """Its kind is wrong at some turns, its shape at others: one cause."""
    result = audit_here(lambda: Arrays(spaces.Discrete(3), spaces.Discrete(2), "ab"), budget=200)
    assert [each.id for each in result.failed if each.id.startswith("GK21")] == ["GK211"]


def test_spaces_of_an_object_are_looked_at() -> None:
    """Of an object alone all is judged but what was before its first reset."""
    verdict = audited(Rovers()).of("GK201")
    assert verdict.outcome == "passed"


class OneForAll(Rovers):
    """An attribute holds a space where PettingZoo has a method that gives an agent's."""

    action_space = spaces.Discrete(5)  # type: ignore[assignment]  # the fault


def test_space_in_place_of_its_method_is_called_so() -> None:
    """The finding names what the attribute is, in place of the TypeError of its call."""
    finding = audited(OneForAll, "GK201").of("GK201").findings[0]
    assert finding.actual == "action_space is a Discrete and no method, before reset"
    assert "action_space(agent)" in finding.fix


def test_late_spaces_still_judge_observations() -> None:
    """Spaces that exist only after a reset are late, and what misses them is told beside."""

    class Late(Rovers):
        def __init__(self) -> None:
            super().__init__()
            self.later, self._seen = self._seen, {}

        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            self._seen = self.later
            return super().reset(seed, options)

        def observation(self, agent: str) -> Any:
            return super().observation(agent) + 2

    assert broken(audited(Late, budget=800)) == ["GK201", "GK214"]


def test_spaces_of_those_who_left_are_asked_for() -> None:
    """An agent that has left still has its spaces."""

    class Forgetful(Rovers):
        def action_space(self, agent: str) -> spaces.Space[Any]:
            if self.agents and agent not in self.agents:
                raise KeyError(agent)
            return super().action_space(agent)

    assert broken(audited(Forgetful, "GK201", budget=800)) == ["GK201"]


def test_observation_of_an_early_death_is_found() -> None:
    """A single agent whose only bad observation is its last one, after one tick."""

    class Brief(Sampler):
        def step(self, actions: dict[Any, Any]) -> Any:
            self.time = 5
            return super().step(actions)

        def give(self, agent: Any) -> Any:
            return super().give(agent) if self.time < 6 else np.full(2, np.nan, np.float32)

    space = spaces.Box(-1, 1, (2,), np.float32)
    verdict = audited(lambda: Brief(space, spaces.Discrete(2), [7])).of("GK215")
    assert verdict.outcome == "failed"
    assert "turn 1" in verdict.findings[0].where


@pytest.mark.parametrize("refused", ["bound", "int"])
def test_actions_random_play_seldom_takes_are_tried(refused: str) -> None:
    """The very bounds of a Box, and an int in place of an np.int64, are actions of the space."""

    class Picky(Sampler):
        def step(self, actions: dict[Any, Any]) -> Any:
            for action in actions.values():
                if (type(action) is int) if refused == "int" else np.any(np.abs(action) >= 1):
                    raise ValueError(f"not {action!r}")
            return super().step(actions)

    done = spaces.Discrete(3) if refused == "int" else spaces.Box(-1, 1, (2,), np.float32)
    make = lambda: Picky(spaces.Discrete(2), done, ("a", "b"))  # noqa: E731
    assert broken(audited(make)) == ["GK221"]


def test_illegal_actions_may_be_refused_or_coerced() -> None:
    """Whatever is done with an illegal action is right, as long as a reset works afterwards."""

    class Mute(Sampler):
        def step(self, actions: dict[Any, Any]) -> Any:
            if set(actions) != set(self.agents):
                raise SystemExit("who is that?")
            return super().step(dict.fromkeys(self.agents, np.int64(0)))

    assert broken(audited(lambda: Mute(spaces.Discrete(2), spaces.Discrete(3), "ab"))) == []


def test_warnings_of_illegal_actions_stay_unsaid(recwarn: pytest.WarningsRecorder) -> None:
    """What NumPy says of a NaN that the audit handed in tells nobody of a fault."""

    class Casting(Sampler):
        def step(self, actions: dict[Any, Any]) -> Any:
            for action in actions.values():
                if action is not None and np.isnan(action).any():
                    warnings.warn("invalid value encountered in cast", RuntimeWarning, stacklevel=1)
            return super().step(dict.fromkeys(self.agents, np.zeros(2, np.float32)))

    thrust = spaces.Box(-1, 1, (2,), np.float32)
    assert broken(audited(lambda: Casting(spaces.Discrete(2), thrust, "ab"))) == []
    assert [str(each.message) for each in recwarn if each.category is RuntimeWarning] == []


@pytest.mark.parametrize("masked", [True, False])
def test_a_space_made_anew_late_in_an_episode_is_found(masked: bool) -> None:
    """It is asked for all along longer plays too, whether masks forbid actions in them or not."""

    class Late(Sampler):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            seen, _ = super().reset(seed, options)
            self.ticks = 0
            return seen, self.infos()

        def infos(self) -> Any:
            mask = {"action_mask": np.array([1, 1, 0], np.int8)} if masked else {}
            return {agent: dict(mask) for agent in self.agents}

        def step(self, actions: dict[Any, Any]) -> Any:
            self.time, self.ticks = 0, self.ticks + 1
            return (*super().step(actions)[:4], self.infos())

        def action_space(self, agent: Any) -> spaces.Space[Any]:
            return spaces.Discrete(3) if self.ticks > 70 else super().action_space(agent)

    verdict = audited(
        lambda: Late(spaces.Discrete(2), spaces.Discrete(3), "ab"), "GK202", budget=1500
    ).of("GK202")
    assert verdict.outcome == "failed"


def test_observations_in_one_array_are_no_wrong_agents_observations() -> None:
    """Each is looked at before the next is asked for, which stands in the same array."""

    class OneArray(LimitOfTheOneInTurn):
        def observe(self, agent: Any) -> Any:
            self.array = self.__dict__.get("array", np.zeros(self.count + 4, np.float32))
            self.array[:] = np.append(Traders.observe(self, agent), self.limits[agent])
            return self.array

    assert audited(OneArray, "GK219", budget=2000).of("GK219").outcome == "passed"


def test_cards_that_hardly_any_player_is_dealt_are_no_wrong_agents_observations() -> None:
    """All see no such card at the turns that are looked at, which tells of nobody's hand."""

    class Cards(Traders):
        def __init__(self, **kwargs: Any) -> None:
            super().__init__(**kwargs)
            size = self.count + 3 + CARDS
            self._seen = {a: spaces.Box(0.0, 1.0, (size,), np.float32) for a in self._seen}

        def reset(self, seed: int | None = None, options: Any = None) -> None:
            super().reset(seed, options)
            dealt = self.rng.permutation(CARDS)
            self.hands = {a: dealt[3 * k :][:3] for k, a in enumerate(self.possible_agents)}

        def observe(self, agent: Any) -> Any:
            hand = np.isin(np.arange(CARDS), self.hands[agent])
            return np.append(super().observe(agent), hand).astype(np.float32)

    assert audited(Cards, "GK219", budget=4000).failed == ()


def test_observations_far_from_the_start_are_found() -> None:
    """What only somebody sees who goes on and on in one direction, and never by random play."""

    class Long(Sampler):
        def reset(self, seed: int | None = None, options: Any = None) -> Any:
            self.way = 0.0
            return super().reset(seed, options)

        def give(self, agent: Any) -> Any:
            return np.array([abs(self.way)], np.float32)

        def step(self, actions: dict[Any, Any]) -> Any:
            self.way = self.way * 0.8 + (int(actions["a"]) - 4)
            self.time = 0
            return super().step(actions)

    space = spaces.Box(0, 17, (1,), np.float32)
    verdict = audited(lambda: Long(space, spaces.Discrete(9), "a"), "GK214", budget=3000).of(
        "GK214"
    )
    assert verdict.outcome == "failed"
    assert "of probe spaces" in verdict.findings[0].where
