"""Checks of action masks, where the matrix doesn't go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.auditing.audit import audit_here
from gamekeeper.checks.spaces.action_masks import is_joint, is_legal
from gamekeeper.contract import Contract
from tests.faults.rovers import Rovers
from tests.faults.tokens import CELLS, Tokens


class Masked(Rovers):
    """Rovers with a mask in their infos; the last move is never allowed."""

    mask: Any = np.array([1, 1, 1, 1, 0], np.int8)

    def info(self, agent: str) -> dict[str, Any]:
        """With the mask."""
        return {"battery": self.battery[agent], "action_mask": self.mask}

    def step(self, actions: dict[str, Any]) -> Any:
        """Refuses the last move."""
        if any(actions[agent] == 4 for agent in self.agents):
            raise ValueError("not there")
        return super().step(actions)


def broken(make: Any, budget: int = 200, contract: Contract | None = None) -> list[str]:
    """Ids of checks of masks and actions that were broken or failed."""
    audit = audit_here(make, select=("GK22", "GK23"), budget=budget, contract=contract)
    return [each.id for each in audit.verdicts if each.outcome in ("failed", "error")]


class Stale(Masked):
    """All moves are allowed, also the refused one."""

    mask = np.ones(5, np.int8)


def test_an_exception_of_a_parallel_step_is_put_down_to_no_agent() -> None:
    """All agents acted in it: the place has a turn and no name."""
    found = audit_here(Stale, select=("GK235",), budget=100).of("GK235")
    assert found.outcome == "failed"
    assert found.findings[0].where.endswith(", raised")


def test_masks_in_infos_are_read() -> None:
    """A mask in the infos of a Parallel environment is as good as one in the observation."""
    assert broken(Masked) == []


@pytest.mark.parametrize(
    ("mask", "ids"),
    [
        ([1, 1, 1, 1, 0], ["GK231"]),
        (np.array([1, 2, 1, 1, 0], np.int8), ["GK231"]),
        (np.array([[1, 1, 1, 1, 0]], np.int8), ["GK230"]),
        (np.ones(4, np.int8), ["GK230"]),
        ("all", ["GK230"]),
        (np.ones(5, np.int8), ["GK235"]),
        (np.array([0, 0, 0, 0, 1], np.int8), ["GK235"]),
    ],
)
def test_masks_are_told_apart(mask: Any, ids: list[str]) -> None:
    """Each way in which a mask is wrong has one check, also where no policy can choose by it."""
    make = type("Wrong", (Masked,), {"mask": mask})
    assert broken(make) == ids


def test_masks_of_waiting_agents_may_be_empty() -> None:
    """All zeros are right for who isn't to move, and for who has ended."""

    class Waiting(Masked):
        def info(self, agent: str) -> dict[str, Any]:
            info = super().info(agent)
            return info if self.battery[agent] > 0 else {**info, "action_mask": self.mask * 0}

    assert broken(Waiting) == []
    assert broken(Tokens) == []


class Levers(Masked):
    """Two choices at once."""

    mask = (np.array([1, 0], np.int8), np.array([1, 1, 0], np.int8))

    def __init__(self) -> None:
        super().__init__()
        self._done = {a: spaces.MultiDiscrete([2, 3]) for a in self.possible_agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """Refuses what the first mask forbids."""
        if any(actions[a].tolist() not in ([0, 0], [0, 1]) for a in self.agents):
            raise ValueError("not there")
        return Rovers.step(self, {a: int(actions[a][1]) for a in self.agents})


@pytest.mark.parametrize(
    ("mask", "ids"),
    [
        (Levers.mask, []),
        (np.array([1, 0, 1, 1, 0], np.int8), []),
        ((Levers.mask[0].astype(bool), Levers.mask[1]), ["GK231"]),
        ((Levers.mask[0], np.ones(3, np.int8)), ["GK235"]),
        ((Levers.mask[0],), ["GK230"]),
        ({"lever": Levers.mask[0], "height": np.ones((2, 3), np.int8)}, []),
    ],
)
def test_masks_of_several_choices_are_judged(mask: Any, ids: list[str]) -> None:
    """MultiDiscrete takes a mask for each part, or a flat one; a dictionary may say more."""
    assert broken(type("Pulled", (Levers,), {"mask": mask})) == ids


class Throttled(Masked):
    """A move, and how hard: the mask bounds the latter."""

    mask: Any = {"move": np.ones(5, np.int8), "power": np.array([0.0, 0.9], np.float32)}  # noqa: RUF012  # never written

    def __init__(self) -> None:
        super().__init__()
        parts = {"move": spaces.Discrete(5), "power": spaces.Box(0.0, 1.0, ())}
        self._done = {a: spaces.Dict(parts) for a in self.possible_agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """Refuses more power than is there."""
        if any(actions[a]["power"] > 0.9 for a in self.agents):
            raise ValueError("too hard")
        return Rovers.step(self, {a: int(actions[a]["move"]) for a in self.agents})


@pytest.mark.parametrize(
    ("mask", "ids"),
    [
        (Throttled.mask, []),
        ({"move": np.ones(5, np.int8)}, ["GK235"]),
        (np.ones(5, np.int8), []),
        (np.ones(4, np.int8), ["GK230"]),
    ],
)
def test_masks_that_bound_continuous_actions_are_not_judged(mask: Any, ids: list[str]) -> None:
    """No list of flags says which numbers such a mask allows; without one all are.

    A mask of the moves alone has one number for each of them.
    """
    assert broken(type("Pushed", (Throttled,), {"mask": mask}), budget=60) == ids


@pytest.mark.parametrize(
    ("declared", "done", "is_kept"),
    [
        ("error", "error", True),
        ("penalty", "penalty", True),
        ("end", "end", True),
        ("end", "penalty", False),
        ("error", "end", False),
    ],
)
def test_forbidden_actions_bring_what_is_declared(declared: str, done: str, is_kept: bool) -> None:
    """Whether a forbidden action raises, costs or ends is compared with the contract."""

    class Strict(Masked):
        def step(self, actions: dict[str, Any]) -> Any:
            bad = [agent for agent in self.agents if actions[agent] == 4]
            if bad and done == "error":
                raise ValueError("not there")
            out = Rovers.step(self, {a: 0 if a in bad else actions[a] for a in self.agents})
            for agent in bad:
                if done == "penalty":
                    out[1][agent] = -1.0
                else:
                    out[2][agent] = True
                    self.agents = [each for each in self.agents if each != agent]
            return out

    role = {"agents": "rover_*", "mask": "infos.action_mask", "illegal": declared}
    contract = Contract.from_json({"roles": {"rover": role}})
    assert broken(Strict, contract=contract) == ([] if is_kept else ["GK237"])


def test_masks_of_turns_are_shown_without_a_step() -> None:
    """What is wrong from the first turn on is shown by a program that steps nothing."""

    class Bool(Tokens):
        def observe(self, agent: str) -> dict[str, Any]:
            seen = super().observe(agent)
            return {**seen, "action_mask": seen["action_mask"].astype(bool)}

    verdict = audit_here(Bool, select=("GK231",), budget=100).of("GK231")
    assert "ACTIONS = []" in verdict.findings[0].reproducer


class OneOfTwoIsEmpty(Tokens):
    """The mask in the info allows nothing, the one in the observation is right."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Infos with a mask of zeros."""
        super().reset(seed, options)
        for agent in self.agents:
            self.infos[agent] = {"action_mask": np.zeros(CELLS, np.int8)}


def test_a_mask_that_differs_from_the_other_is_one_cause() -> None:
    """An empty mask beside one that isn't is told as masks that disagree, and no more."""
    found = audit_here(OneOfTwoIsEmpty, select=("GK233", "GK234"), budget=60)
    assert [each.id for each in found.failed] == ["GK234"]


PAIRS = np.array([[1, 0, 1], [0, 1, 1]], np.int8)


@pytest.mark.parametrize(
    ("space", "action", "is_allowed"),
    [
        (spaces.MultiDiscrete([2, 3]), [0, 1], False),
        (spaces.Tuple([spaces.Discrete(2), spaces.Discrete(3, start=5)]), (1, 6), True),
        (spaces.Dict(b=spaces.Discrete(2), a=spaces.Discrete(3)), {"a": 1, "b": 0}, False),
        (spaces.Dict({"b": spaces.Discrete(2), "a": spaces.Discrete(3)}), {"a": 2, "b": 0}, True),
    ],
    ids=str,
)
def test_a_number_for_each_joint_action_is_a_mask(
    space: Any, action: Any, is_allowed: bool
) -> None:
    """One of other sizes, or with a Box, has none; a Dict's axes are told by their sizes."""
    assert is_joint(space, PAIRS)
    assert is_joint(space, PAIRS.T) is isinstance(space, spaces.Dict)
    assert not is_joint(space, PAIRS[:, :2])
    assert is_legal(space, PAIRS, action) is is_allowed
    assert not is_joint(spaces.Tuple([spaces.Discrete(2), spaces.Box(0, 1, (3,))]), PAIRS)
