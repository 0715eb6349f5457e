"""Five tasks for two agents: what `gamekeeper new` writes is measured to be what was answered."""

from pathlib import Path
from typing import Any

import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.contract import Contract
from tests.cli.lines import document

BUDGET = 1_500
"""Steps of an audit that measures every field of these small tasks."""
TASKS = {
    # A carrier sees what the picker did in the same round; a battery ends one of them alone.
    "line": "--agents picker --agents carrier --stages picker,carrier --sees yes "
    "--conflicts ordered --observes multidiscrete:6,6 --reward delivery=shared:carrier:all "
    "--ending done=termination:all --ending battery=truncation:agent --horizon 30",
    # Nobody sees who is ahead, and the first of a round that wants the cell has it.
    "race": "--agents robot=2 --sees no --order rotating --conflicts ordered --observes box:2 "
    "--reward prize=individual:robot --ending over=termination:all --horizon 2",
    # All at once, asked one after the other.
    "hands": "--agents player=2 --sees no --order none --api aec --observes box:2 --horizon 20",
    # All at once, in one tick.
    "lift": "--agents lifter --agents holder --observes box:2 --reward up=shared:all:all "
    "--ending raised=termination:all --horizon 20",
    # Open bids in an order that is drawn; what one gains the other pays.
    "auction": "--agents bidder=2 --sees yes --order random --conflicts ordered --observes box:2 "
    "--reward sale=zero-sum:bidder:all --ending sold=termination:all --horizon 20",
}


def written(name: str, folder: Path, capture: pytest.CaptureFixture[str]) -> Any:
    """The document of `gamekeeper new` for a task."""
    code, told = document(
        capture, "new", f"{name}_task", *TASKS[name].split(), "--yes", "--out", folder
    )
    assert code == 0
    return told


@pytest.mark.parametrize("name", TASKS)
def test_new_task_is_measured_as_it_was_answered(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The audit passes, and each field that it measures is the one of the contract."""
    told = written(name, tmp_path, capfd)
    source = tmp_path / "src" / f"{name}_task"
    found = audit_here(f"{source / 'env.py'}:{name.capitalize()}Task", budget=BUDGET)
    assert (found.ok, found.api) == (True, told["api"])
    contract = Contract.load(source / f"{name}_task.toml")
    measured, schedule = found.measured, contract.schedule
    answers = {
        "stages": [list(stage) for stage in schedule.stages or ()],
        "order": schedule.order,
        "observe": schedule.observe,
        "conflicts": schedule.conflicts,
        "horizon": schedule.horizon,
        "deterministic": True,
        "may_join": [],
        "may_leave": [],
        "advice": told["advice"],
    }
    seen = {key: measured[key] for key in answers if measured[key] is not None}
    assert seen == {key: answers[key] for key in seen}
    assert {"order", "observe", "advice"} <= set(seen)
    kinds = {term.kind for term in contract.rewards.values()}
    assert "shared" in kinds or not measured["reward"]["shared"]
    assert "zero-sum" in kinds or not measured["reward"]["zero_sum"]
    declared = {(ending.kind, ending.owner) for ending in contract.endings.values()}
    endings = {(each["kind"], each["owner"]) for each in measured["endings"]["kinds"] or ()}
    assert endings <= declared
