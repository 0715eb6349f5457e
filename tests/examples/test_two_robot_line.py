from pathlib import Path

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from examples.two_robot_line import make
from gamekeeper.contract import Contract
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.interface.contract_draft import agent_specs, draft_contract, open_questions

CONTRACT = Path(__file__).parents[2] / "examples" / "two_robot_line.toml"


def play(env, *joint):
    """Resets and plays the joint actions of picker and carrier; what the last step gave."""
    env.reset(seed=3)
    return [env.step({"picker": picker, "carrier": carrier}) for picker, carrier in joint][-1]


def test_two_robot_line_conforms_to_pettingzoo(capsys):
    """PettingZoo's own tests pass without a warning, and the example prints nothing itself."""
    parallel_api_test(make(), num_cycles=200)
    parallel_seed_test(make)
    capsys.readouterr()
    play(make(), (2, 0))
    assert capsys.readouterr().out == ""


def test_two_robot_line_starts_at_the_ends():
    """Rule 1: picker in cell 0, carrier in cell 4, observations inside their spaces."""
    env = make()
    seen, infos = env.reset(seed=1)
    assert {agent: int(cell[0]) for agent, cell in seen.items()} == {"picker": 0, "carrier": 4}
    assert infos == {"picker": {"position": 0}, "carrier": {"position": 4}}
    assert all(env.observation_space(agent).contains(cell) for agent, cell in seen.items())
    assert all(cell.dtype == np.int64 for cell in seen.values())


@pytest.mark.parametrize(
    ("joint", "cells"),
    [([(1, 1)], (0, 4)), ([(0, 2)], (0, 4)), ([(2, 0)], (1, 3)), ([(2, 1), (0, 1)], (0, 4))],
)
def test_two_robot_line_moves_both_at_once_and_stops_at_the_ends(joint, cells):
    """Rule 2: one cell down, nowhere, one cell up, never off the line."""
    seen, rewards, terminated, truncated, infos = play(make(), *joint)
    assert tuple(int(seen[agent][0]) for agent in ("picker", "carrier")) == cells
    assert tuple(infos[agent]["position"] for agent in ("picker", "carrier")) == cells
    assert rewards == {"picker": 0.0, "carrier": 0.0}
    assert not any(terminated.values()) | any(truncated.values())


@pytest.mark.parametrize("joint", [[(2, 0), (2, 0)], [(2, 1)] * 4])
def test_two_robot_line_pays_and_ends_both_when_they_meet(joint):
    """Rule 3: 1.0 each and terminated, with nobody left."""
    env = make()
    _, rewards, terminated, truncated, _ = play(env, *joint)
    assert rewards == {"picker": 1.0, "carrier": 1.0}
    assert all(terminated.values())
    assert not any(truncated.values())
    assert env.agents == []


def test_two_robot_line_lets_robots_pass_each_other():
    """Rule 4: who swaps cells hasn't met."""
    env = make()
    _, rewards, terminated, _, _ = play(env, (2, 1), (2, 0), (2, 0))
    assert not any(terminated.values())
    assert rewards["picker"] == 0.0
    assert env.agents == ["picker", "carrier"]


def test_two_robot_line_renders_its_line():
    """The ansi form shows both robots, and a star where they met; without a mode there is none."""
    env = make(render_mode="ansi")
    env.reset()
    assert env.render() == "p...c"
    play(env, (2, 0), (2, 0))
    assert env.render() == "..*.."
    assert make().render() is None


def test_two_robot_line_contract_fits_and_leaves_nothing_open():
    """The contract beside it declares what the draft sees, and answers every question."""
    env = make()
    contract = Contract.load(CONTRACT)
    drafted = draft_contract(env)
    assert (contract.name, contract.api) == (drafted.name, drafted.api)
    assert list(contract.roles) == list(drafted.roles)
    specs = agent_specs(env, contract)
    assert [spec.noop_action() for spec in specs] == [1, 1]
    assert all(isinstance(spec, AgentSpec) for spec in specs)
    assert open_questions(contract, specs) == ()
