"""Agents that a shared policy can't tell apart are named before training."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import gamekeeper as gk
from gamekeeper.adapters import requirements
from gamekeeper.adapters.requirements import role_of
from gamekeeper.adapters.shared_observations import alike
from gamekeeper.runs.recording import joint_policy_of
from tests.adapters import ledger


class _Pair:
    """Two that see the time, alone or with their number; a third of another role sees the same."""

    def __init__(self, numbered: bool = False) -> None:
        super().__init__()
        self.numbered = numbered
        self.possible_agents = ["ant_0", "ant_1", "bee_0"]
        self.observation_spaces = dict.fromkeys(
            self.possible_agents, spaces.Box(0, 99, (2,), np.float32)
        )
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(2))

    def start(self, rng: Any, options: Any) -> None:
        self.time = 0

    def observe(self, agent: str) -> Any:
        number = int(agent[-1]) if self.numbered else 0
        return np.array([self.time, number], np.float32)

    def mask(self, agent: str) -> Any:
        return np.array([agent == "ant_0", 1], np.int8)


class Pair(_Pair, gk.TickEnv):
    """At once."""

    metadata = {"name": "pair_v0"}  # noqa: RUF012  # as PettingZoo has it

    def tick(self, actions: dict[str, Any]) -> None:
        self.time += 1
        for agent in list(self.agents) if self.time == 5 else ():
            self.terminate(agent)


class PairInTurn(_Pair, gk.TurnEnv):
    """One by one."""

    metadata = {"name": "pair_in_turn_v0"}  # noqa: RUF012  # as PettingZoo has it

    def act(self, agent: str, action: Any) -> None:
        self.time += 1
        for each in list(self.agents) if self.time == 9 else ():
            self.terminate(each)


def found(kind: Any, api: str, **kwargs: Any) -> Any:
    """What is alike in an environment of this kind."""
    env = kind(**kwargs)
    return alike(env, joint_policy_of("random", env, None), api, lambda agent: role_of(None, agent))


@pytest.mark.parametrize(("kind", "api"), [(Pair, "parallel"), (PairInTurn, "aec")])
def test_agents_that_are_shown_the_same_are_found(kind: Any, api: str) -> None:
    """By role; masks, which no network reads, tell nothing; an agent's number does."""
    agents, looks = found(kind, api)["ant"]
    assert agents == ["ant_0", "ant_1"]
    assert looks > 2
    assert found(kind, api, numbered=True) == {}


@pytest.mark.parametrize("seen", ledger.SEEN)
def test_agents_that_are_shown_their_number_are_not_found(seen: str) -> None:
    """In any form of observation."""
    assert found(ledger.LedgerTicks, "parallel", seen=seen, mask=True, ends="late") == {}


def test_likeness_is_said_before_training(monkeypatch: Any, capsys: Any) -> None:
    """Once, on stderr, after the audit."""
    monkeypatch.setattr(requirements, "audit", lambda *_, **__: SimpleNamespace(failed=[]))
    for _ in range(2):
        requirements.checked(Pair, "quick")
    said = [line for line in capsys.readouterr().err.splitlines() if "same observation" in line]
    assert len(said) == 1
    assert said[0].startswith("gamekeeper: ant_0, ant_1 were shown")
