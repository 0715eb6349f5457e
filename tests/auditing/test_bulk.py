"""How much memory an audit's evidence takes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Text, Tuple
from pettingzoo import ParallelEnv

from gamekeeper.auditing import gather
from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.evidence_memory import held_bytes, slimmed, space_bytes
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeRun
from gamekeeper.episodes.episode import Episode
from gamekeeper.rollouts.episode_loop import EpisodePlan, perform

SIDE = 64


class Screen(ParallelEnv[str, Any, int]):
    """Two agents see a picture of 12 kB that they paint; one tick is as any other."""

    metadata = {"name": "screen_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way
    render_mode = None

    def __init__(self) -> None:
        self.possible_agents = ["a", "b"]
        self.space = Box(0, 255, (SIDE, SIDE, 3), np.uint8)
        self.actions = {agent: Discrete(256) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Any:
        """A picture."""
        return self.space

    def action_space(self, agent: str) -> Any:
        """Colours."""
        return self.actions[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """A black screen."""
        self.agents, self.tick = self.possible_agents[:], 0
        self.picture = np.zeros((SIDE, SIDE, 3), np.uint8)
        return self._seen(), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, int]) -> Any:
        """Each colours a line."""
        self.tick += 1
        for place, agent in enumerate(self.agents):
            self.picture[(2 * self.tick + place) % SIDE] = actions[agent]
        ended = dict.fromkeys(self.agents, self.tick >= 200)
        given = dict.fromkeys(ended, 0.0), dict.fromkeys(ended, False), ended
        seen, infos = self._seen(), {agent: {} for agent in ended}
        self.agents = [] if self.tick >= 200 else self.agents
        return seen, *given, infos

    def _seen(self) -> dict[str, Any]:
        return {agent: self.picture.copy() for agent in self.agents}


@pytest.mark.parametrize(
    ("space", "size_bytes"),
    [
        (Box(0, 1, (3, 4), np.float32), 48),
        (Dict({"a": Box(0, 255, (10,), np.uint8), "b": MultiDiscrete([3, 3])}), 26),
        (Tuple((Box(0, 1, (2,), np.float64), Discrete(3))), 24),
        (Text(8), 0),
        (None, 0),
    ],
)
def test_space_bytes_counts_arrays(space: Any, size_bytes: int) -> None:
    """Arrays count with all their elements, however deep they stand; texts don't."""
    assert size_bytes == space_bytes(space)


def test_evidence_of_pictures_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plays are fewer and shorter where what they show is large, and still are looked at."""
    free = audit_here(Screen, budget=2_000, select=("GK214",))
    monkeypatch.setattr(gather, "EVIDENCE_BYTES", 4 << 20)
    bound = audit_here(Screen, budget=2_000, select=("GK214",))
    assert bound.steps < free.steps / 3
    assert (bound.of("GK214").outcome, free.of("GK214").outcome) == ("passed", "passed")


def played() -> Episode:
    """Ten ticks, each with another picture."""
    actions = tuple({"a": tick, "b": 2 * tick} for tick in range(10))
    return perform(EpisodePlan(seed=1, actions=actions), Screen()).episode


def test_counterfactual_that_went_alike_shares_its_rows() -> None:
    """A unchanged rerun and a changed play without a difference take no memory of their own."""
    base = played()
    counterfactual = ProbeCounterfactual(base, played(), played(), {"change": "Nothing"})
    slim = slimmed(counterfactual)
    assert slim.unchanged_rerun.steps is base.steps
    assert slim.episode.steps is base.steps
    assert (slim.noise, slim.divergence) == (None, None)
    assert held_bytes(ProbeRun(counterfactuals=(slim,))) * 3 == held_bytes(
        ProbeRun(counterfactuals=(counterfactual,))
    )


def test_counterfactual_that_went_another_way_keeps_its_rows() -> None:
    """What differs stays as it was."""
    base = played()
    other = perform(EpisodePlan(seed=1, actions=({"a": 1, "b": 1},)), Screen()).episode
    slim = slimmed(ProbeCounterfactual(base, played(), other, {}))
    assert slim.episode is other
    assert slim.divergence is not None
    assert slim.divergence == replace(slim, _cache={}).divergence
