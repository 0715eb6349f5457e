import subprocess
import sys

import pettingzoo
import pytest

import gamekeeper.tasks  # noqa: F401  # registers the tasks
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.interface.contract_draft import agent_specs
from gamekeeper.interface.opening import open_env

TASKS = {
    "connect_four": "aec",
    "foraging": "parallel",
    "handover": "aec",
    "pursuit": "parallel",
    "reference": "parallel",
    "robotic_warehouse": "parallel",
    "speaker_listener": "parallel",
    "spread": "parallel",
    "tag": "parallel",
    "tictactoe": "aec",
    "two_robot_line": "parallel",
    "warehouse": "parallel",
    "warehouse_turns": "aec",
}
WITH_KNOBS = ("handover", "two_robot_line", "warehouse", "warehouse_turns")
"""Tasks of our own; the others keep the rules of those they are known from."""


def registered():
    """Our ids by API, as PettingZoo knows them."""
    registries = {"aec": pettingzoo.aec_registry, "parallel": pettingzoo.parallel_registry}
    return {
        env_id: api for api, ids in registries.items() for env_id in ids if "gamekeeper/" in env_id
    }


def test_tasks_are_registered():
    """Each task stands in the registry of its API, under our namespace and version 0."""
    assert registered() == {f"gamekeeper/{name}-v0": api for name, api in TASKS.items()}


def test_registration_imports_no_task():
    """Importing the package registers names; a task's module is imported when it is made."""
    code = (
        "import sys, gamekeeper.tasks; print(*[m for m in sys.modules if 'gamekeeper.tasks.' in m])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


def test_opening_a_task_imports_no_other():
    """An id is resolved by the registry; the tasks that weren't asked for stay unread."""
    code = (
        "import sys; from gamekeeper.interface.opening import open_env; open_env('two_robot_line');"
        "print(*[m for m in sys.modules if m.startswith('gamekeeper.tasks.')])"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True
    )
    assert "gamekeeper.tasks.two_robot_line" in done.stdout.split()
    assert not {f"gamekeeper.tasks.{name}" for name in ("handover", "warehouse")} & set(
        done.stdout.split()
    )


@pytest.mark.parametrize(("name", "api"), TASKS.items())
def test_task_opens_by_its_short_name(name, api):
    """`handover` alone opens the task in its own API, with its contract, and three policies."""
    opened = open_env(name)
    env = opened.env.unwrapped
    assert api == opened.api == env.declared.api
    assert env.metadata["name"] == env.declared.name
    assert env.declared.name.rpartition("_v")[0] == name
    assert set(env.policies) == {"reference", "greedy", "lazy"}
    assert open_questions(env.declared, agent_specs(env, env.declared)) == ()


@pytest.mark.parametrize("name", WITH_KNOBS)
def test_task_takes_the_knobs_of_its_contract(name):
    """Every knob of the contract is an argument, with 0 for its ideal."""
    declared = open_env(name).env.unwrapped.declared
    assert len(declared.knobs) >= 8
    assert {knob.ideal for knob in declared.knobs.values()} == {0}
    open_env(name, **dict.fromkeys(declared.knobs, 1))
