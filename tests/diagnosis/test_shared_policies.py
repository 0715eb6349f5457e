"""A rerun has the recorded set-up, down to which agents one object plays; else it says so first."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.cli._app import run_line
from gamekeeper.cli.diagnose import diagnosis_code
from gamekeeper.diagnosis.contradictions import contradictions
from gamekeeper.diagnosis.diagnosis_result import Tested as OneTest
from gamekeeper.diagnosis.open_setup import setup_of
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.reporting.diagnosis_text import diagnosis_text
from gamekeeper.runs.standing import choices_in

ENV = '''
import gamekeeper as gk
from gymnasium import spaces

class Agree(gk.TickEnv):
    """Two agents are paid where they choose alike."""

    metadata = {"name": "agree_v0"}

    def __init__(self, turns=4):
        super().__init__()
        self.turns, self.possible_agents = turns, ["a", "b"]
        self.observation_spaces = {x: spaces.Discrete(9) for x in "ab"}
        self.action_spaces = {x: spaces.Discrete(2) for x in "ab"}

    def start(self, rng, options):
        self.now = 0

    def tick(self, actions):
        self.now += 1
        one, two = actions.values()
        for agent in "ab":
            self.add_reward(agent, float(one == two))
            if self.now == self.turns:
                self.terminate(agent, "done")

    def observe(self, agent):
        return self.now
'''
POLICY = '''
class Alternating:
    """0, 1, 0, 1, ...: two agents of one object never choose alike, those of two always do."""

    def __init__(self):
        self.count = 0

    def reset(self, seed):
        self.count = seed % 2

    def __call__(self, observation, agent, info, rng):
        self.count += 1
        return self.count % 2
'''
BROKEN = """
class Broken:
    def reset(self, seed):
        self.count = 0

    def __call__(self, observation, agent, info, rng):
        self.count += 1
        return self.count // (self.count < 3)

broken = Broken()
"""
SHARED = {"a": "alternating.py:Alternating", "b": "same:a"}
FAILED = "return < 1"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an environment and a policy that remembers, as the current one."""
    (tmp_path / "agree.py").write_text(ENV)
    (tmp_path / "alternating.py").write_text(POLICY)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def recorded(policies: Any, out: str | None = None, **options: Any) -> Evidence:
    """Twenty episodes."""
    return gk.rollout("agree.py:Agree", policies=policies, episodes=20, out=out, **options)


def objects(evidence: Evidence) -> dict[str, str]:
    """The objects that the evidence names, by agent."""
    named = json.loads(evidence.episode_table["policies"][0].as_py())
    return {agent: each["object"] for agent, each in named.items()}


def test_evidence_keeps_who_shared_an_object(folder: Path) -> None:
    """A text gives each agent its own object, but for `same:`; Python's own stay."""
    name = "alternating.py:Alternating"
    (folder / "kept.py").write_text(f"{POLICY}\nkept = Alternating()\n")
    for apart in (name, "kept.py:kept"):
        assert objects(recorded(apart)) == {"a": "a", "b": "b"}
        assert objects(recorded({"a": apart, "b": apart})) == {"a": "a", "b": "b"}
    assert objects(recorded(SHARED)) == {"a": "a", "b": "a"}
    assert objects(recorded({"*": name, "b": "same:*"})) == {"a": "*", "b": "*"}

    def one(observation: Any, agent: Any, info: Any, rng: Any) -> int:
        return 0

    assert objects(recorded({"a": one, "b": one})) == {"a": "a", "b": "a"}


def test_a_run_from_before_agents_had_an_object_each_is_played_as_it_was() -> None:
    """Who shared one then shares it again; a choice of now is kept as it was typed."""
    entry = {"policy": "x.py:X", "version": "1", "chosen_for": "*", "object": "*"}
    before = json.dumps({"a": entry, "b": entry})
    assert choices_in(before) == {"*": "x.py:X", "a": "same:*", "b": "same:*"}
    now = {x: {**entry, "object": x, "own": True} for x in "ab"}
    assert choices_in(json.dumps(now)) == {"*": "x.py:X"}


def test_policies_that_share_choose_again_as_they_did(folder: Path) -> None:
    """`replay --policies` plays every episode with the same sharing, order and resets."""
    name = "alternating.py:Alternating"
    for number, policies in enumerate((name, {"a": name, "b": name}, {"a": name, "b": "same:a"})):
        recorded(policies, out=f"run-{number}")
        replayed = gk.replay(f"run-{number}", policies=True, allow_import=True)
        assert replayed.verified, (policies, replayed)


def test_agents_that_no_choice_is_for_keep_their_recorded_policy(folder: Path) -> None:
    """Also where they shared the replaced agent's object; a run without names says so."""
    name = "alternating.py:Alternating"
    chosen = setup_of(recorded({"a": name, "b": "same:a"}), policies={"a": "random"})
    assert chosen.policies == {"a": "random", "b": name}
    chosen = setup_of(recorded(name), policies={"a": "random"})
    assert chosen.policies == {"a": "random", "*": name}
    with pytest.raises(gk.EvidenceError, match="no policy for b"):
        setup_of(_without_names(), policies={"a": "random"})


def _without_names() -> Evidence:
    env = gk.record(gk.make("agree.py:Agree"), "unnamed")
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 0))
    env.close()
    return gk.load("unnamed")


def test_workers_share_as_one_process_does(folder: Path) -> None:
    """The evidence is the same for any number of workers."""
    alone = recorded(SHARED)
    fanned = recorded(SHARED, out="fanned", workers=2)
    assert fanned.fingerprint == alone.fingerprint


def test_a_shared_policy_that_failed_fails_again(folder: Path) -> None:
    """The unchanged rerun has one object too: 20 of 20 failed, and so do fresh episodes."""
    evidence = recorded(SHARED)
    found = gk.diagnose(
        evidence, failed=FAILED, perturbations=False, allow_import=True, episodes=200
    )
    assert found.recorded == {"team": (20, 20)}
    assert found.team is not None
    assert found.team.success[0] == 0.0
    assert found.contradictions == {}
    changes = {each.intervention for each in found.team.tested}
    assert "resetting a and b's memory" in changes


def test_a_named_policy_contradicts_no_recorded_episode(folder: Path) -> None:
    """What another policy plays may differ from the recording; the diagnosis says who played."""
    evidence = recorded(SHARED)
    options: dict[str, Any] = {"failed": FAILED, "perturbations": False, "allow_import": True}
    found = gk.diagnose(evidence, policies={"*": "first-legal"}, episodes=200, **options)
    assert found.policies == {"*": "first-legal"}
    assert found.fresh["team"][0] == 0
    assert found.contradictions == {}


def test_attribution_plays_one_object_for_both(folder: Path) -> None:
    """Fresh episodes of an attribution pay what the recorded ones did."""
    evidence = recorded(SHARED)
    assert gk.attribute(evidence, episodes=5, action_episodes=0).everyone == 0.0


def test_a_contradiction_is_said_first_and_is_no_all_clear(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Recorded 20 of 20 failed, fresh none: in text, JSON, Python and by the exit code."""
    recorded(SHARED, out="run")
    (folder / "generous.py").write_text(ENV.replace("float(one == two)", "1.0"))
    options: dict[str, Any] = {"failed": FAILED, "perturbations": False, "allow_import": True}
    fair = gk.diagnose("run", env="generous.py:Agree", episodes=100, **options)
    assert fair.contradictions["team"].recorded == (20, 20)
    assert fair.contradictions["team"].fresh == (0, 64)
    assert fair.team is not None
    for text in (
        str(fair),
        fair.team.why,
        fair.agents["a"].why,
        fair._repr_html_(),
        json.dumps(fair.to_json()["contradictions"]),
    ):
        assert "no all-clear" in text
    shown = diagnosis_text(json.loads(json.dumps(fair.to_json())), width=80)
    assert shown.startswith("Contradiction  team: 20 of 20 recorded episodes failed and 0 of 64")
    assert "not significantly below" not in shown
    line = [
        "diagnose",
        "run",
        "--failed",
        FAILED,
        "--env",
        "generous.py:Agree",
        "--episodes",
        "100",
    ]
    code = run_line([*line, "--no-perturbations", "--workers", "0", "--allow-import"])
    assert code == 2
    assert capsys.readouterr().out.startswith("Contradiction")
    test = OneTest("control", "x = 0", "ideal", 0.5, 0.4, 0.6, 0.001, 64, restores=True)
    a = replace(fair.agents["a"], answer="isolated", substitutes=("x = 0",), tested=(test,))
    assert diagnosis_code(replace(fair, agents={"a": a})) == 0
    alone = replace(a, tested=(replace(test, restores=False),))  # by evidence alone
    assert diagnosis_code(replace(fair, agents={"a": alone})) == 2


def test_shares_that_chance_explains_are_no_contradiction() -> None:
    """One failed episode of a system that fails now and then, or a picked one, says nothing."""
    assert contradictions({"team": (1, 1)}, {"team": (0, 64)}) == {}
    assert contradictions({"team": (5, 20)}, {"team": (12, 64)}) == {}
    assert contradictions({"team": (3, 20), "gone": (9, 9)}, {"team": (0, 0)}) == {}
    found = contradictions({"team": (0, 20)}, {"team": (60, 64)})
    assert found["team"].p < 1e-12


def test_a_policy_that_raises_is_said_first_and_its_cut_is_no_limit(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The run was cut since it raised, so that new episodes go on until it raises again."""
    (folder / "broken.py").write_text(BROKEN)
    with pytest.raises(gk.PolicyError):
        gk.rollout("two_robot_line", policies={"carrier": "broken.py:broken"}, out="run")
    assert setup_of(gk.load("run")).most_turns > 1_000
    line = ["diagnose", "run", "--failed", "return < -1e9", "--workers", "0", "--allow-import"]
    code, out = run_line(line), capsys.readouterr().out
    assert code == 1
    assert out.startswith("Raised  carrier's policy broke off at turn 2 in 64 of 64 new episodes")
    assert "Healthy" not in out


def test_a_limit_of_turns_is_kept() -> None:
    """The manifest says it; a run without one had a limit where several were cut alike."""
    limited = gk.rollout("handover", episodes=2, most_turns=3)
    assert setup_of(limited).most_turns == 3
    untold = {key: x for key, x in limited.manifest.items() if key != "most_turns"}
    assert setup_of(replace(limited, manifest=untold)).most_turns == 3
    assert setup_of(gk.rollout("handover", episodes=1)).most_turns > 1_000
