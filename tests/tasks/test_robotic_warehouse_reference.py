"""The warehouse is rware's, step by step: rware runs on our random numbers beside it."""

from functools import cache

import networkx
import numpy as np
import pytest
import rware
from rware.warehouse import RewardType, Warehouse

from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.robotic_warehouse.robotic_warehouse import RoboticWarehouse

BIASED = [0.05, 0.6, 0.12, 0.12, 0.11]
"""Uniform actions seldom go anywhere; these make crowds, and deliveries."""
DENSE = """
    .x.x.x
    xgxx.x
    .x..gx
    xx.x..
"""
ALLEY = "xx...g...xx"
CASES = {
    "tiny": {"layout": "tiny", "n_agents": 2},
    "tiny, uniform": {"layout": "tiny", "n_agents": 4, "request_queue_size": 8},
    "small": {"layout": "small", "n_agents": 9, "reward_type": "global", "sensor_range": 2},
    "medium": {"layout": "medium", "n_agents": 6, "reward_type": "two_stage"},
    "large": {"layout": "large", "n_agents": 30, "request_queue_size": 100},
    "low": {"layout": "tiny", "column_height": 1, "n_agents": 12, "request_queue_size": 3},
    "dense": {"layout": DENSE, "n_agents": 12, "request_queue_size": 9, "sensor_range": 3},
    "two stages": {
        "layout": DENSE,
        "n_agents": 5,
        "request_queue_size": 10,
        "reward_type": "two_stage",
    },
    "alley": {
        "layout": ALLEY,
        "n_agents": 5,
        "request_queue_size": 3,
        "max_inactivity_steps": 9,
        "max_steps": 60,
        "normalised_coordinates": False,
    },
    "scaled": {
        "layout": DENSE,
        "n_agents": 3,
        "normalised_coordinates": True,
        "reward_type": "global",
        "max_inactivity_steps": 40,
        "request_queue_size": 11,
    },
}


class Drawn:
    """Stands in for rware's generator: the same choices, out of our stream."""

    def __init__(self, stream):
        self.stream = stream

    def choice(self, values, size=None, replace=True):
        """As numpy's; shelves that may be requested next stand in the order of their cells."""
        if size is None:
            values = sorted(values, key=lambda shelf: (shelf.y, shelf.x))
            return values[self.stream.integers(len(values))]
        drawn = []
        while len(drawn) < size:
            k = self.stream.integers(len(values))
            if replace or k not in drawn:
                drawn.append(k)
        return np.array(values, dtype=object if hasattr(values[0], "x") else None)[drawn]


class Ties:
    """Longest chains as networkx finds them; where two are equally long, R6 chooses, and counts."""

    def __init__(self, env):
        self.env, self.count, self.original = env, 0, networkx.algorithms.dag_longest_path

    def __call__(self, graph):
        """The longest chain, the last cell last."""

        @cache
        def length(cell):
            return 1 + max((length(other) for other in graph.pred[cell]), default=0)

        (last,) = [cell for cell in graph if not graph.succ[cell]]
        chain, is_tied = [last], False
        while graph.pred[chain[0]]:
            behind = sorted(
                graph.pred[chain[0]], key=lambda cell: self.env.grid[0, cell[1], cell[0]]
            )
            best = [cell for cell in behind if length(cell) == max(map(length, behind))]
            is_tied |= len(best) > 1
            chain.insert(0, best[0])
        found = self.original(graph)
        assert len(found) == len(chain)
        self.count += is_tied
        return chain if is_tied else found


def reference_of(*, layout, reward_type="individual", **told):
    """The rware environment of our arguments."""
    rows, columns = rware._sizes.get(layout, (1, 1))
    told = {
        "column_height": 8,
        "sensor_range": 1,
        "request_queue_size": told["n_agents"],
        "max_inactivity_steps": None,
        "max_steps": 500,
        **told,
    }
    return Warehouse(
        shelf_rows=rows,
        shelf_columns=columns,
        msg_bits=0,
        reward_type=RewardType[reward_type.upper()],
        layout=None if layout in rware._sizes else "\n".join(map(str.strip, layout.split())),
        **told,
    )


def compare(arguments, *, steps, seed, monkeypatch, weights=BIASED):
    """Plays both; deliveries, ties and ends seen."""
    ours, theirs = RoboticWarehouse(**arguments, debug=True), reference_of(**arguments)
    ties = Ties(theirs)
    monkeypatch.setattr(networkx.algorithms, "dag_longest_path", ties)
    rng = np.random.default_rng(seed)
    agents, paid, ends, begins = ours.possible_agents, 0.0, 0, True
    for step in range(steps):
        if begins:
            begins = False
            mine, _ = ours.reset(seed=seed + 1000 * ends)
            theirs._np_random = Drawn(Stream(ours.rng.seed, ours.rng.episode))
            seen, _ = theirs.reset()
        else:
            actions = rng.choice(5, len(agents), p=weights)
            mine, rewards, terminated, truncated, _ = ours.step(
                dict(zip(agents, actions.tolist(), strict=True))
            )
            seen, expected, begins, _, _ = theirs.step(actions.tolist())
            assert expected == [rewards[agent] for agent in agents], step
            assert [begins] * len(agents) == [terminated[a] or truncated[a] for a in agents], step
            paid, ends = paid + sum(expected), ends + begins
        np.testing.assert_array_equal(np.stack(seen), np.stack([mine[a] for a in agents]))
    return paid, ties.count, ends


@pytest.mark.filterwarnings("ignore:.*precision lowered by casting:UserWarning")  # rware's spaces
@pytest.mark.parametrize("name", CASES)
def test_robotic_warehouse_is_rware_step_by_step(name, monkeypatch):
    """Observations, rewards and ends are equal bit by bit, from the first state on."""
    weights = [0.2] * 5 if "uniform" in name else BIASED
    steps = 80 if name == "large" else 200  # a step of rware takes long there
    paid, _, ends = compare(
        CASES[name], steps=steps, seed=len(name), monkeypatch=monkeypatch, weights=weights
    )
    assert paid > 0 or name not in ("dense", "two stages")
    assert ends > 0 or name != "alley"
