"""Diagnoses of recorded runs, from end to end."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.diagnosis_result import Diagnosis
from gamekeeper.diagnosis.open_setup import OpenSetup
from gamekeeper.diagnosis.shortest_failure import shrunk
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import ContractError, EvidenceError, RunError, TrustError
from gamekeeper.reporting.diagnosis_screen import diagnosis_screen
from gamekeeper.runs.load_run import load


def run(spec: str = "handover", policies: Any = "reference", **kwargs: Any) -> Evidence:
    """A run of ten episodes in memory."""
    return gk.rollout(spec, policies=policies, episodes=10, seed=1, env_kwargs=kwargs)


def plainly(evidence: Any, **options: Any) -> Diagnosis:
    """A diagnosis without perturbations."""
    return gk.diagnose(evidence, perturbations=False, **options)


def test_a_knob_of_one_agent_is_isolated_and_is_that_agents() -> None:
    """The other one is told whose it is."""
    found = plainly(run(latency={"giver_0": 3}, occlusion=0.02))
    assert found.team is not None
    assert (found.team.answer, found.team.labels) == ("isolated", ("timing",))
    assert found.agents["giver_0"].labels == ("timing",)
    assert found.agents["receiver_0"].answer == "elsewhere"
    assert "latency[giver_0] = 0" in found.agents["receiver_0"].why
    tested = {each.intervention: each for each in found.agents["giver_0"].tested}
    assert tested["latency[giver_0] = 0"].restores
    assert tested["latency[giver_0] = 0"].n >= 50
    assert not tested["occlusion = 0.0"].restores
    assert found.recorded == {"team": (10, 10)}
    first = found.counterfactuals[0]
    assert (first.failed, first.restored) == (True, True)
    assert first.turn is not None


def test_two_knobs_that_only_cure_together_are_joint() -> None:
    """Neither alone helps."""
    found = plainly(run(observation_noise=2.0, actuator_slip=0.5))
    assert found.team is not None
    assert (found.team.answer, found.team.labels) == ("joint", ("perception", "control"))


def test_a_policy_that_is_replaced_has_no_label() -> None:
    """It is isolated to its agent; which part of it isn't shown."""
    found = plainly(run(policies={"giver": "noop", "receiver": "reference"}))
    giver = found.agents["giver_0"]
    assert (giver.answer, giver.labels, giver.component) == ("isolated", (), "giver_0's policy")
    assert "which part of it can't be told apart" in giver.why
    assert found.agents["receiver_0"].answer == "elsewhere"


def test_a_horizon_shorter_than_declared_is_evaluation() -> None:
    """The declared protocol restores."""
    found = plainly(run(horizon=30))
    assert found.team is not None
    assert found.team.labels == ("evaluation",)


def test_a_sound_run_has_no_cause() -> None:
    """Also where a knob is turned that does no harm."""
    found = gk.diagnose(run(occlusion=0.01))
    assert not found.has_cause
    assert found.episodes < 100


def test_a_fault_without_a_handle_is_not_named() -> None:
    """The condition can't be met by any ideal substitute, so nothing is."""
    found = plainly(run(occlusion=0.02), failed="length > 0", episodes=350)
    assert found.team is not None
    assert (found.team.answer, found.team.labels) == ("unexplained", ())
    assert "no ideal substitute restores" in found.team.why


def test_perturbations_show_dependence_and_never_a_cause() -> None:
    """A sound run depends on what its agents see, and no cause is named."""
    found = gk.diagnose(run(), episodes=1_500, perturbations=True)
    kinds = {each.kind for agent in found.agents.values() for each in agent.tested}
    assert kinds == {"perturbation"}
    tested = {each.intervention: each for each in found.agents["giver_0"].tested}
    assert tested["ObservationBias[giver_0]"].depends
    assert 0.0 < (tested["ObservationBias[giver_0]"].flips_at or 0.0) < 0.2
    assert not found.has_cause


def test_equal_seeds_give_equal_answers_however_many_work(tmp_path: Path) -> None:
    """One process, a worker, or a second call that goes on: the same document."""
    evidence = run(latency=3)
    apart = plainly(evidence, episodes=300, workers=2)
    here = plainly(evidence, episodes=300, out=tmp_path / "d")
    again = plainly(evidence, episodes=300, out=tmp_path / "d")
    assert again.episodes == 9  # three counterfactuals, which no file keeps
    assert again.reused == here.episodes - 9 - sum(map(_episodes, here.runs.values()))
    for one in (here, again):
        same = {**one.to_json(), "episodes": apart.episodes, "reused": 0, "runs": {}}
        assert same == apart.to_json()


def _episodes(folder: str) -> int:
    return load(folder).episode_table.num_rows


def test_a_stopped_diagnosis_goes_on(tmp_path: Path) -> None:
    """What was played isn't played again, nor is a line that was torn."""
    evidence, seen = run(latency=3), []

    def stop(fields: dict[str, Any]) -> None:
        seen.append(fields)
        if len(seen) > 40:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plainly(evidence, out=tmp_path, on_message=stop)
    notes = tmp_path / "outcomes.jsonl"
    lines = len(notes.read_text().splitlines())
    with notes.open("a") as file:
        file.write('{"key": ["unchanged rerun"')
    found = plainly(evidence, out=tmp_path)
    whole = plainly(evidence, out=tmp_path / "whole")
    assert (found.reused, found.episodes) == (lines - 1, whole.episodes - lines + 1)
    assert found.agents == whole.agents


@pytest.mark.parametrize(
    ("most", "kwargs"),
    [
        (100, {"latency": 3}),
        (200, {"latency": 3}),
        (300, {"latency": 3}),
        (300, {"observation_noise": 2.0, "actuator_slip": 0.5}),
        (500, {"observation_noise": 2.0, "actuator_slip": 0.5}),
        (700, {"latency": {"giver_0": 3}, "occlusion": 0.02}),
    ],
)
def test_no_more_episodes_are_played_than_allowed(
    most: int, kwargs: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Search, confirmation, counterfactuals, perturbations and recordings together."""
    evidence = run(**kwargs)
    played = []
    plan = OpenSetup.plan
    monkeypatch.setattr(OpenSetup, "plan", lambda *a: played.append(a) or plan(*a))
    found = gk.diagnose(evidence, episodes=most, out=tmp_path / "d", perturbations=most > 500)
    recorded = sum(map(_episodes, found.runs.values()))
    assert len(played) + recorded == found.episodes <= most
    assert found.not_played or found.episodes < most
    assert found.to_json()["most_episodes"] == most


def test_what_the_budget_did_not_reach_is_said() -> None:
    """No cause by default of rivals that weren't played."""
    few = plainly(run(latency=3), episodes=100)
    assert few.team is not None
    assert few.not_played == ("ideal substitutes: latency = 0", "undos from outside")
    assert "limit of 100 episodes was reached" in few.team.why
    assert ("timing", "the limit of 100 episodes was reached") in few.team.not_tested
    evidence = run(latency=3, occlusion=0.02, actuator_slip=0.05)
    part = plainly(evidence, episodes=250).team
    assert part is not None
    assert [each.n for each in part.tested] == [64, 64]
    assert part.answer != "isolated"
    more = plainly(evidence, episodes=300)
    assert more.team is not None
    assert more.team.answer == "isolated"
    assert more.not_played[0] == "several ideal substitutes at once"


def test_a_budget_in_steps_binds_and_says_what_it_left() -> None:
    """What was played is as long as allowed, and the screen says what wasn't played."""
    evidence = run(latency=3)
    budget = 100 * max(episode.header["turns"] for episode in evidence.episodes)
    found = plainly(evidence, episodes=300, budget=budget)
    assert budget // 2 < found.steps <= budget
    assert found.not_played
    text = diagnosis_screen({**found.to_json(), "run": "runs/x"}, width=200)
    assert f"{found.steps:,} of {budget:,} env steps" in text
    assert f"--budget {2 * budget}" in text
    assert f"Not tried  {found.not_played[0]}" in text
    with pytest.raises(EvidenceError, match="too few"):
        plainly(evidence, budget=budget - 1)


def test_a_budget_that_is_too_small_is_refused_at_once() -> None:
    """The same from Python as on the command line, with the fix."""
    with pytest.raises(EvidenceError, match="50 episodes are too few for a diagnosis") as caught:
        plainly(run(latency=3), episodes=50)
    assert caught.value.expected == "100 or more"
    assert "episodes=" in (caught.value.fix or "")


def test_counterfactuals_replay_and_another_experiment_is_refused(tmp_path: Path) -> None:
    """Runs of the unchanged rerun and of what restores stand on their own."""
    evidence = run(latency=3)
    found = plainly(evidence, out=tmp_path)
    assert list(found.runs) == ["unchanged", "latency = 0"]
    for folder in found.runs.values():
        assert gk.replay(folder).verified
    assert json.loads((tmp_path / "diagnosis.json").read_text()) == found.to_json()
    with pytest.raises(RunError, match="outcomes of another experiment") as caught:
        plainly(evidence, out=tmp_path, seed=5)
    assert caught.value.actual.startswith("seed was 0, is 5")
    with pytest.raises(RunError, match="outcomes of another experiment"):
        plainly(evidence, out=tmp_path, policies={"*": "greedy"})


@pytest.mark.usefixtures("nothing_is_ours")
def test_code_that_evidence_names_is_not_run_unasked(tmp_path: Path) -> None:
    """A policy with a colon is code."""
    gk.rollout(
        "handover",
        policies={"giver": "gamekeeper.tasks.handover.handover_rules:reference"},
        episodes=2,
        out=tmp_path / "r",
    )
    with pytest.raises(TrustError, match="would execute code"):
        plainly(tmp_path / "r")
    assert plainly(tmp_path / "r", allow_import=True).run == str(tmp_path / "r")


def test_objects_of_this_process_play_here_alone() -> None:
    """A callable is diagnosed in this process, and refused to workers."""

    def still(observation: Any, agent: Any, info: Any, rng: Any) -> int:
        return 0

    evidence = run(policies={"giver": still, "receiver": "reference"})
    policies = {"giver": still, "receiver": "reference"}
    found = plainly(evidence, policies=policies)
    assert found.agents["giver_0"].component == "giver_0's policy"
    with pytest.raises(EvidenceError, match="an object of this process"):
        plainly(evidence, policies=policies, workers=2)


def test_a_run_without_a_condition_asks_for_one() -> None:
    """What failed means is data."""
    evidence = gk.rollout("tictactoe", episodes=4)
    with pytest.raises(ContractError, match="nothing says when an episode failed") as caught:
        plainly(evidence, contract=gk.Contract())
    proposed = re.search("failed '(length < .+?)'", str(caught.value))  # all team returns are 0
    assert proposed is not None
    failing = gk.diagnose(evidence, contract=gk.Contract(), failed=proposed[1], episodes=100)
    assert 0 < failing.recorded["team"][0] < 4


def test_shrunk_play_fails_in_the_same_way_and_replays(tmp_path: Path) -> None:
    """Fewer turns and acts, the same endings, evidence that replays."""
    found = shrunk(run(latency={"giver_0": 3}), 0, out=tmp_path / "s")
    assert found.turns[0] <= found.turns[1]
    assert found.acts[0] < found.acts[1]
    assert found.is_least
    assert gk.replay(tmp_path / "s").verified


def test_shrunk_refuses_what_does_not_fail() -> None:
    """There is nothing to cut down."""
    with pytest.raises(EvidenceError, match="doesn't fail"):
        shrunk(run(), 0)
    with pytest.raises(EvidenceError, match="has no episode 99"):
        shrunk(run(), 99)
