"""Playing on from a recorded turn: one thing is changed, and everything else goes on as it did."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.open_setup import setup_of
from gamekeeper.diagnosis.play_on import (
    BranchPoint,
    PlayOnOptions,
    check_consent,
    futures,
    offers,
    record_future,
)
from gamekeeper.diagnosis.play_on_tasks import play_on_task
from gamekeeper.errors import EvidenceError, TrustError
from tests.diagnosis.test_pivots import Vault

HOLD, LET_GO = 0, 1


def silent(**fields: Any) -> None:
    """Hears of what was played."""


@pytest.fixture(scope="module")
def vault(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two guards who hold a vault that is never lost by chance."""
    run = tmp_path_factory.mktemp("vault") / "run"
    gk.rollout(f"{Vault.__module__}:Vault", policies="first-legal", episodes=2, seed=3, out=run)
    return run


def ordered(run: Path, branch: BranchPoint, **extra: Any) -> dict[str, Any]:
    """Arguments of a task in this process."""
    evidence = gk.load(run)
    return {
        "run": str(run),
        "setup": setup_of(evidence).to_json(),
        "contract": evidence.contract.to_json(),
        "branch": asdict(branch),
        **extra,
    }


def played(run: Path, branch: BranchPoint, numbers: int = 8, budget: int = 9_999) -> dict[str, Any]:
    """Both arms, in this process."""
    extra = {"numbers": list(range(numbers)), "budget": budget}
    return play_on_task(silent, kind="futures", **ordered(run, branch, **extra))


@pytest.mark.parametrize("action", [HOLD, LET_GO])
def test_recorded_future_differs_first_where_it_was_changed(
    vault: Path, tmp_path: Path, action: int
) -> None:
    """With the recorded action it is the recording; with another one it differs from there."""
    branch = BranchPoint(episode=1, turn=5, agent="left", action=action)
    order = ordered(vault, branch, number=None, out=str(tmp_path / "future"))
    assert play_on_task(silent, kind="record", **order) == {"error": None, "replays": True}
    future, base = gk.load(tmp_path / "future"), gk.load(vault)
    assert base.header(1)["seed"] == future.header(0)["seed"]
    rows = [
        each.steps.drop_columns(["episode"]).to_pylist()
        for each in (base.episode(1), future.episode(0))
    ]
    changed = [one["turn"] for one, two in zip(*rows, strict=True) if one != two]
    assert (min(changed) if changed else None) == (None if action == HOLD else 5)
    assert future.manifest["played_on"]["root"] == base.root


def test_futures_are_paired(vault: Path) -> None:
    """Equal numbers draw equally: with the recorded action, both arms are the same."""
    found = played(vault, BranchPoint(episode=0, turn=3, agent="right", action=HOLD))
    assert found["as_recorded"] == found["changed"]
    found = played(vault, BranchPoint(episode=0, turn=3, agent="right", action=LET_GO))
    assert found["as_recorded"]["returns"]["left"] == [1.0] * 8
    assert found["changed"]["returns"]["left"] == [0.0] * 8
    assert found["changed"]["paths"][0][0] == (3, 0.0)
    assert found["as_recorded"]["paths"][0][-1] == (12, 2.0)


def test_another_policy_plays_from_the_turn_on(vault: Path) -> None:
    """Up to the turn it is shown what was recorded; from there on it chooses."""
    early = played(vault, BranchPoint(episode=0, turn=0, agent="left", policy="random"))
    late = played(vault, BranchPoint(episode=0, turn=11, agent="left", policy="random"))
    assert max(early["changed"]["returns"]["left"]) == 0.0
    assert {0.0, 1.0} == set(late["changed"]["returns"]["left"])
    assert late["as_recorded"]["returns"]["left"] == [1.0] * 8


def test_budget_ends_both_arms_alike(vault: Path) -> None:
    """Pairs, as far as both were played."""
    found = played(vault, BranchPoint(episode=0, turn=0, agent="left", policy="random"), budget=200)
    counts = [len(found[arm]["numbers"]) for arm in ("as_recorded", "changed")]
    assert counts[0] == counts[1] < 8


@pytest.mark.parametrize(
    ("where", "what"),
    [
        ({"agent": "left", "action": 7}, "can't do this"),
        ({"agent": "left", "action": [1, 2]}, "can't do this"),
        ({"agent": "nobody", "action": 0}, "doesn't act"),
        ({"agent": "nobody", "policy": "random"}, "acts nowhere"),
    ],
)
def test_what_can_not_be_done_is_refused(vault: Path, where: dict[str, Any], what: str) -> None:
    """With the turn, and what could."""
    error = played(vault, BranchPoint(episode=0, turn=2, **where))["error"]
    assert what in error["what"]
    assert "turn 2" in error["where"] or "episode 0" in error["where"]
    assert error["expected"]


@pytest.mark.parametrize(
    ("branch", "count", "what"),
    [
        (BranchPoint(episode=9, turn=0, agent="left", action=0), 8, "no episode 9"),
        (BranchPoint(episode=0, turn=12, agent="left", action=0), 8, "nothing is done at turn 12"),
        (BranchPoint(episode=0, turn=0, agent="left", action=0), 10_000, "can't be played at once"),
        (BranchPoint(episode=0, turn=0, agent="left", policy="os:getcwd"), 8, "named before"),
    ],
)
def test_order_is_checked_before_anything_runs(
    vault: Path, branch: BranchPoint, count: int, what: str
) -> None:
    """Its episode, its turn, its number of futures, its policy."""
    with pytest.raises(EvidenceError, match=what):
        futures(vault, branch, count=count)


def test_one_thing_is_changed() -> None:
    """Not two, and not none."""
    for both in ({}, {"action": 1, "policy": "random"}):
        with pytest.raises(EvidenceError, match="one thing"):
            BranchPoint(episode=0, turn=0, agent="left", **both)


@pytest.mark.usefixtures("nothing_is_ours")
def test_code_that_the_run_names_needs_consent(tmp_path: Path) -> None:
    """As replaying it does."""
    policy = "gamekeeper.tasks.handover.handover_rules:reference"
    gk.rollout("handover", policies={"giver": policy}, episodes=1, out=tmp_path / "r")
    branch = BranchPoint(episode=0, turn=0, agent="giver_0", action=0)
    with pytest.raises(TrustError):
        check_consent(tmp_path / "r", PlayOnOptions())
    with pytest.raises(TrustError):
        record_future(tmp_path / "r", branch, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    check_consent(tmp_path / "r", PlayOnOptions(allow_import=True))


def test_environment_runs_in_a_process_of_its_own(tmp_path: Path) -> None:
    """Offers and figures come back from there."""
    gk.rollout("two_robot_line", policies="random", episodes=1, out=tmp_path / "line")
    offered = offers(tmp_path / "line", 0)["picker"]
    assert {"random", "first-legal", "reference"} <= set(offered.policies)
    assert offered.actions
    heard: list[dict[str, Any]] = []
    branch = BranchPoint(episode=0, turn=1, agent="picker", policy="reference")
    found = futures(tmp_path / "line", branch, count=4, on_message=heard.append).to_json()
    assert {"played": 8, "of": 8} in heard
    assert found["team"]["difference"]["n"] == 4
    assert found["text"] == "picker played by reference from turn 1 on"
