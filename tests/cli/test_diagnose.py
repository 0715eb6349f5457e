"""`gamekeeper diagnose` and `gamekeeper label`."""

import subprocess
import sys
from pathlib import Path

import pytest

import gamekeeper as gk
from tests.cli.lines import SURROUNDINGS, document, said

QUICK = ("--all", "--no-perturbations", "--workers", "0", "--episodes", "400")


@pytest.fixture(name="run")
def _run(tmp_path: Path) -> Path:
    """A failing run."""
    path = tmp_path / "r"
    gk.rollout(
        "handover",
        policies="reference",
        episodes=3,
        out=path,
        env_kwargs={"latency": {"giver_0": 3}},
    )
    return path


def test_diagnose_tells_every_agent_and_keeps_what_it_did(
    run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 0; a folder beside the run, labels in its annotations, lines of 80 columns."""
    code, out, _ = said(capfd, "diagnose", str(run), *QUICK)
    assert code == 0
    assert "The cause is timing (isolated): latency[giver_0] = 0 restores success" in out
    assert "giver_0: as for the team" in out
    assert "receiver_0: another agent's" in out
    assert "An episode counts as failed if undelivered > 0" in out
    assert "Failed: 3 of 3 recorded episodes, and 64 of 64 new ones" in out
    assert max(map(len, out.replace(str(run), "r").splitlines())) <= 80
    assert (run.with_name("r-diagnosis") / "diagnosis.json").is_file()
    code, found = document(capfd, "label", str(run))
    assert [each["label"] for each in found["labels"]] == ["timing"]


def test_diagnose_beside_a_good_run_names_the_least_set(
    run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 0; both values of each difference, and whose it is."""
    good = tmp_path / "good"
    gk.rollout("handover", policies="reference", episodes=2, seed=1, out=good)
    code, out, _ = said(capfd, "diagnose", str(run), "--good", str(good), *QUICK)
    assert code == 0
    assert "latency[giver_0] as in the good run explains the gap" in out
    assert "* latency[giver_0]  3    not given  100% of the gap" in out
    assert "receiver_0: another agent's" in out


def test_diagnose_document_has_the_promised_fields(
    run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """As the interface lists them."""
    code, found = document(capfd, "diagnose", str(run), *QUICK)
    assert code == 0
    giver = found["agents"]["giver_0"]
    assert {"answer", "labels", "tested", "not_tested"} <= giver.keys()
    assert {"label", "intervention", "kind", "effect", "low", "high", "p"} <= giver["tested"][
        0
    ].keys()
    assert {"label", "why"} == giver["not_tested"][0].keys()


def test_diagnose_that_cannot_tell_exits_with_2(
    run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """It fails, and no ideal substitute restores."""
    code, out, _ = said(capfd, "diagnose", str(run), *QUICK, "--failed", "length > 0")
    assert code == 2
    assert "no ideal substitute restores" in " ".join(out.split())


def test_diagnose_tries_a_named_policy_in_an_agents_place(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """It restores: the agent's policy is named, without a label."""
    run = tmp_path / "r"
    policies = {"giver": "noop", "receiver": "reference"}
    gk.rollout("handover", policies=policies, episodes=2, out=run)
    good = "gamekeeper.tasks.handover.handover_rules:reference"
    given = (*QUICK, "--try", f"giver_0={good}")
    code, found = document(capfd, "diagnose", str(run), *given)
    giver = found["agents"]["giver_0"]
    assert (code, giver["answer"], giver["labels"]) == (0, "isolated", [])
    assert giver["component"] == "giver_0's policy"
    kinds = {each["intervention"]: each["kind"] for each in giver["tested"]}
    assert kinds[f"giving giver_0 the policy {good}"] == "swap"


def test_diagnose_saves_a_case_that_passes(
    run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The file is a test of its own."""
    case = tmp_path / "test_case.py"
    code, _, _ = said(capfd, "diagnose", str(run), *QUICK, "--save-case", str(case))
    assert code == 0
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(case)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=SURROUNDINGS,
    )
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout


def test_diagnose_shrinks_an_episode(run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The shortest play lies beside the run."""
    code, found = document(capfd, "diagnose", str(run), "--shrink", "0")
    assert code == 0
    assert found["acts"][0] < found["acts"][1]
    assert gk.replay(found["shortest_run"]).verified


def test_label_by_hand_is_listed(run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """What a person says, where and why."""
    code, found = document(
        capfd,
        "label",
        str(run),
        "control",
        "--agent",
        "giver_0",
        "--episode",
        "1",
        "--why",
        "it drops things",
        "--by",
        "ann",
    )
    assert code == 0
    assert found["labels"][0]["by"] == "ann"
    code, out, _ = said(capfd, "label", str(run), "--agent", "giver_0")
    assert "control: giver_0, episode 1" in out
    code, out, _ = said(capfd, "show", str(run))
    assert "Failure labels\n  control: giver_0, episode 1" in out
    code, _, err = said(capfd, "label", str(run), "bad-luck")
    assert code == 2
    assert "no failure label" in err
