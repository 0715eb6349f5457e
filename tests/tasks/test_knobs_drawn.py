"""What knobs draw at once is what their streams draw number by number."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.knobs import LABELS, LANES, Disturbances, Knobs

AGENTS = ("picker_0", "picker_1")
SIZE = 37
THINGS = tuple((at, at + 3) for at in range(0, 30, 3))


def disturbances(seed: int, **knobs: Any) -> Disturbances:
    """Those of two agents that see 37 whole numbers, at the beginning of an episode."""
    made = Disturbances(
        Knobs(knobs, agents=AGENTS),
        bounds={agent: (np.full(SIZE, -9), np.full(SIZE, 9)) for agent in AGENTS},
        things=dict.fromkeys(AGENTS, THINGS),
        noop=0,
        neighbours={},
    )
    made.begin(Stream(seed, 3))
    return made


def clean(agent: str) -> Any:
    """What would be seen."""
    return np.arange(SIZE, dtype=np.int16) % 10


def one_by_one(seed: int, agent: str, turn: int, hides: float, noise: float) -> Any:
    """The rule of the knobs, as it stands in their page."""
    shown = clean(agent).astype(np.float64)
    lane = (AGENTS.index(agent) + 1) * LANES
    stream = Stream(seed, 3, lane=lane + list(LABELS).index("occlusion"))
    stream.draws = turn * 2 * len(THINGS)
    for first, end in THINGS:
        if stream.uniform() < hides:
            shown[first:end] = 0
    stream = Stream(seed, 3, lane=lane + list(LABELS).index("observation_noise"))
    stream.draws = turn * 2 * SIZE
    shown += [stream.normal(0.0, noise) for _ in range(SIZE)]
    return np.clip(np.rint(shown), -9, 9).astype(np.int16)


@pytest.mark.parametrize("order", ["forwards", "backwards"])
def test_knobs_show_what_their_streams_draw(order: str) -> None:
    """At every turn, in whatever order turns are asked for, over many arrays of draws."""
    made = disturbances(7, occlusion=0.4, observation_noise=1.3)
    turns = range(0, 300, 7) if order == "forwards" else range(300, 0, -7)
    for turn in turns:
        for agent in AGENTS:
            made.turns[agent] = turn
            assert np.array_equal(made.shown(agent, clean), one_by_one(7, agent, turn, 0.4, 1.3))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_draw_on_as_the_original(copied: Any) -> None:
    """What is drawn ahead needn't be copied; a new episode draws anew."""
    made = disturbances(7, observation_noise=1.3)
    made.turns["picker_0"] = 5
    made.shown("picker_0", clean)
    counterfactual = copied(made)
    for each in (made, counterfactual):
        each.turns["picker_0"] = 6
        assert np.array_equal(each.shown("picker_0", clean), one_by_one(7, "picker_0", 6, 0, 1.3))
    counterfactual.begin(Stream(8, 3))
    assert np.array_equal(
        counterfactual.shown("picker_0", clean), one_by_one(8, "picker_0", 0, 0, 1.3)
    )
