"""What is handed out, handed over and called once more: cases beside the faulty environments."""

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.probes.held_values import HeldValues
from gamekeeper.auditing.result import AuditResult
from tests.faults import Faulty, environments
from tests.faults.lanterns import Lanterns
from tests.faults.rovers import Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders

MINE = ("GK61", "GK62", "GK63", "GK70")
FAULTY = [each for each in environments().values() if "".join(each.checks).startswith(MINE)]


def seen(spec: object, *ids: str, budget: int = 600) -> AuditResult:
    """An audit by these checks alone."""
    return audit_here(spec, select=ids, budget=budget)


def outcomes(spec: object, *ids: str) -> dict[str, str]:
    """The outcomes of these checks."""
    return {verdict.id: verdict.outcome for verdict in seen(spec, *ids).verdicts}


@pytest.mark.parametrize("each", FAULTY, ids=lambda each: each.env.__name__)
def test_snippet_passes_once_the_fault_is_fixed(each: Faulty) -> None:
    """The program of a finding raises nothing on the clean environment under the faulty one."""
    clean = next(cls for cls in each.env.__mro__[1:] if cls not in {each.env for each in FAULTY})
    result = seen(each.spec, *each.checks, budget=300)
    verdict = result.failed[0]
    assert result.findings[: len(verdict.findings)] == verdict.findings
    program = verdict.findings[0].reproducer
    fixed = program.replace(
        f"from {each.env.__module__} import {each.env.__name__} as build",
        f"from {clean.__module__} import {clean.__name__} as build",
    )
    assert fixed != program
    exec(fixed, {})


class Ledger(ParallelEnv[int, Any, Any]):
    """Two agents with numbers for names who write into arrays; each step's part may be faulty."""

    metadata: dict[str, Any] = {"name": "ledger_v0"}  # noqa: RUF012  # as PettingZoo has it
    render_mode = None

    def __init__(self, fault: str = "", most: int = 6) -> None:
        self.fault, self.most = fault, most
        self.possible_agents = [0, 1]
        self.agents: list[int] = []
        self._box = spaces.Box(-1.0, 1.0, (2,), np.float32)

    def observation_space(self, agent: int) -> spaces.Space[Any]:
        """One space for all."""
        return self._box

    def action_space(self, agent: int) -> spaces.Space[Any]:
        """One space for all."""
        return self._box

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """An empty book."""
        self.agents, self.time = [0, 1], 0
        self.book = np.zeros((2, 2), np.float32)
        self.last: Any = None
        return self.seen(), {a: {} for a in self.agents}

    def seen(self) -> dict[int, Any]:
        """What each wrote last."""
        if self.fault == "views":
            return {a: self.book[a] for a in self.agents}
        if self.fault == "read-only":
            view = self.book.copy()[0]
            view.flags.writeable = False
            return dict.fromkeys(self.agents, view)
        return {a: self.book[a].copy() for a in self.agents}

    def step(self, actions: dict[int, Any]) -> Any:
        """Writes down what both did."""
        if self.fault == "clipped":
            for action in actions.values():
                np.clip(action, -0.5, 0.5, out=action)
        if self.fault == "inertia" and self.last is not None:
            self.book += 0.1 * np.stack([self.last[a] for a in self.agents])
        self.last = dict(actions)
        self.book[:] = self.book / 2 + np.stack([actions[a] for a in self.agents]) / 2
        self.time += 1
        out = self.seen(), *(dict.fromkeys(self.agents, v) for v in (0.0, False)), {}, {}
        ended = self.time >= self.most
        out = (*out[:3], dict.fromkeys(self.agents, ended), {a: {} for a in self.agents})
        self.agents = [] if ended else self.agents
        return out


def test_agents_may_have_numbers_for_names() -> None:
    """A clean environment whose agents are numbers is kept throughout."""
    assert {"passed"} == set(outcomes(Ledger, "GK610", "GK613", "GK614", "GK620", "GK630").values())


@pytest.mark.parametrize(
    ("fault", "id"), [("views", "GK610"), ("clipped", "GK630"), ("inertia", "GK631")]
)
def test_arrays_of_actions_and_views_are_looked_at(fault: str, id: str) -> None:
    """Rows of one array, clipping in place and actions that are kept are found."""
    assert outcomes(lambda: Ledger(fault), id) == {id: "failed"}


def test_rows_of_one_array_are_apart() -> None:
    """Views of one array that don't overlap share no memory."""
    assert outcomes(lambda: Ledger("views"), "GK614") == {"GK614": "passed"}


def test_every_pair_that_shares_is_counted() -> None:
    """The share that is told is of all the pairs that were looked at."""
    one: dict[str, Any] = {}
    values = HeldValues(age=1)
    values.look_at_pairs(0, {"infos": {"a": {}, "b": {}, "c": {}}})
    values.look_at_pairs(1, {"infos": {"a": one, "b": one, "c": one}})
    assert (values.pairs["infos"], values.alike["infos"]) == (6, 3)
    assert values.shared["infos"] == (1, ("a", "b"))


def test_read_only_arrays_may_be_shared() -> None:
    """One array for all is fine where nobody can write into it."""
    found = outcomes(lambda: Ledger("read-only"), "GK614", "GK620")
    assert found["GK614"] == "passed"
    assert found["GK620"] == "not_applicable"


@pytest.mark.parametrize("kind", [Rovers, Traders, Tokens, Lanterns])
def test_an_object_alone_can_be_looked_at(kind: Any) -> None:
    """Where no second instance can be had, nothing is broken on a clean environment."""
    env = kind()
    ids = ("GK61", "GK62", "GK63")
    assert [v.id for v in seen(env, *ids, budget=400).verdicts if v.outcome == "failed"] == []
    assert outcomes(env, "GK610") == {"GK610": "passed"}


class Noisy(Rovers):
    """Draws from a generator that no seed determines."""

    def drive(self, agent: str, action: int) -> None:
        """Somewhere."""
        super().drive(agent, int(np.random.default_rng().integers(5)))


def test_unseeded_noise_is_nobodys_fault() -> None:
    """A game that never repeats is not blamed on calls, copies or writing."""
    found = seen(Noisy, "GK62", "GK63", "GK70", budget=400)
    assert [v.id for v in found.verdicts if v.outcome == "failed"] == []


class Lonely(AECEnv[str, Any, Any]):
    """One agent that ends with its first turn."""

    metadata: dict[str, Any] = {"name": "lonely_v0"}  # noqa: RUF012  # as PettingZoo has it
    render_mode = None

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["one"]
        self.agents: list[str] = []
        self._space = spaces.Discrete(2)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._space

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._space

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """One turn to go."""
        self.agents = ["one"]
        self.agent_selection = "one"
        self.rewards, self._cumulative_rewards = {"one": 0.0}, {"one": 0.0}
        self.terminations, self.truncations = {"one": False}, {"one": False}
        self.infos: dict[str, Any] = {"one": {}}
        self._skip_agent_selection = None

    def observe(self, agent: str) -> int:
        """A plain number."""
        return 1

    def step(self, action: Any) -> None:
        """The end."""
        if self.terminations["one"]:
            self._was_dead_step(action)
            return
        self.terminations["one"] = True


def test_an_episode_of_one_turn_can_be_looked_at() -> None:
    """Plain observations and an early end give no error and no finding."""
    found = seen(Lonely, "GK61", "GK62", "GK63", "GK7", budget=600)
    assert {v.outcome for v in found.verdicts} <= {"passed", "not_exercised", "not_applicable"}
