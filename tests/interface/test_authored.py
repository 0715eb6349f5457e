"""What both base classes give an author beside the books: horizon and contract."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from gamekeeper.errors import ContractError
from tests.interface.relays import TurnRelay


@pytest.mark.parametrize("n", [1, 2, 5])
def test_horizon_truncates_after_so_many_ticks(n: int) -> None:
    """Everybody has had `horizon` turns when the time is up; the rules' own endings stand."""
    env = TurnRelay(n, max_cycles=4)
    env.reset(seed=0)
    turns = dict.fromkeys(env.agents, 0)
    for agent in env.agent_iter():
        if env.truncations[agent]:
            env.step(None)
            continue
        turns[agent] += 1
        env.step(0)
    assert {4} == set(turns.values())
    assert {"horizon"} == set(env.endings.values())
    assert 4 * n == env.turns


def test_horizon_counts_ticks_in_any_order() -> None:
    """With an order of its own a tick is over when an agent comes to its second turn in it."""

    class Again(TurnRelay):
        def next_agent(self, agent: str) -> str:
            return "runner_0" if self.turns % 4 == 1 else super().next_agent(agent)

    env = Again(3, max_cycles=3)
    env.reset(seed=0)
    order = []
    while not env.endings:
        order.append(int(env.agent_selection[-1]))
        env.step(0)
    assert order == [0, 0, 1, 2, 0]  # ticks: 0 | 0 1 2 | 0, the last over as 0 would come again


@pytest.mark.parametrize(
    ("joins", "then", "order"),
    [
        (1, {}, [0, 1, 2, 0, 1]),  # ticks: 0 1 | 2 0 1, at the end of the roster
        (2, {2: 2}, [0, 1, 2, 0, 1]),  # the same; it comes before the first by the task's order
        (2, {2: 0, 3: 2, 4: 1}, [0, 1, 0, 2, 1]),  # 0 1 | 0 2 1: it comes in the midst
        (1, {1: 2, 2: 1, 3: 0}, [0, 2, 1, 0, 1, 2]),  # 0 2 1 | 0 1 2: it acts at once
    ],
)
def test_horizon_counts_ticks_where_agents_join(
    joins: int, then: dict[int, int], order: list[int]
) -> None:
    """A tick is over when all who were live as it began had their turn, whoever comes next."""

    class Growing(TurnRelay):
        def starting_agents(self) -> list[str]:
            return ["runner_0", "runner_1"]

        def act(self, agent: str, action: int) -> None:
            if self.turns == joins:
                self.join("runner_2")

        def next_agent(self, agent: str) -> str:
            chosen = then.get(self.turns)
            return super().next_agent(agent) if chosen is None else f"runner_{chosen}"

    env = Growing(3, max_cycles=2)
    env.reset(seed=0)
    played = []
    while not env.endings:
        played.append(int(env.agent_selection[-1]))
        env.step(0)
    assert played == order


def test_horizon_does_not_wait_for_who_has_ended() -> None:
    """A tick is over although an agent ended before its turn in it, and another one joined."""

    class Losing(TurnRelay):
        def starting_agents(self) -> list[str]:
            return ["runner_0", "runner_1"]

        def act(self, agent: str, action: int) -> None:
            if self.turns == 1:
                self.truncate("runner_1", "lost")
                self.join("runner_2")

    env = Losing(3, max_cycles=2)
    env.reset(seed=0)
    played = []
    while set(env.endings.values()) != {"lost", "horizon"}:
        played.append(int(env.agent_selection[-1]))
        env.step(None if env.truncations[env.agent_selection] else 0)
    assert played == [0, 1, 2, 0]  # ticks: 0, and 1's last turn | 2 0


@pytest.mark.parametrize("horizon", [0, -1, 1.5, True])
def test_horizon_is_a_number_of_ticks(horizon: Any) -> None:
    """What can't be a number of ticks is refused as the environment is built."""
    with pytest.raises(ContractError, match="horizon"):
        TurnRelay(max_cycles=horizon)


TASK = """
from gymnasium.spaces import Discrete
from gamekeeper.interface.turn_env import TurnEnv

class Task(TurnEnv):
    contract = "task.toml"

    def __init__(self, **given):
        super().__init__(**given)
        self.possible_agents = ["a_0", "a_1"]
        self.action_spaces = self.observation_spaces = dict.fromkeys(["a_0", "a_1"], Discrete(2))

    def observe(self, agent):
        return 0

    def act(self, agent, action):
        pass
"""


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A task in a file of its own, with its contract beside it."""
    (tmp_path / "task_in_a_file.py").write_text(TASK)
    (tmp_path / "task.toml").write_text('name = "task_v0"\n[schedule]\nhorizon = 3\n')
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "task_in_a_file", raising=False)
    return importlib.import_module("task_in_a_file")


def test_contract_beside_the_file_gives_the_horizon(task: ModuleType, tmp_path: Path) -> None:
    """The path is found from the class; the contract's horizon holds where none is given."""
    env = task.Task()
    assert tmp_path / "task.toml" == env.contract_path
    assert env.declared.name == "task_v0"
    for given, expected in ((task.Task(), 6), (task.Task(horizon=2), 4)):
        given.reset()
        while not given.endings:
            given.step(0)
        assert expected == given.turns


def test_contract_of_a_subclass_lies_beside_its_base(task: ModuleType, tmp_path: Path) -> None:
    """The file that says where the contract lies counts, wherever a subclass was made."""

    class Other(task.Task):  # type: ignore[name-defined, misc]  # a module made by the fixture
        pass

    assert tmp_path / "task.toml" == Other().contract_path
    assert TurnRelay().contract_path is None
    assert TurnRelay().declared is None


def test_missing_contract_is_named(task: ModuleType, tmp_path: Path) -> None:
    """A contract that isn't there is an error that names the file."""
    (tmp_path / "task.toml").unlink()
    with pytest.raises(ContractError, match=r"task\.toml"):
        task.Task().reset()
