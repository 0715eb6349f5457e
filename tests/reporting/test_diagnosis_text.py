"""A diagnosis as text: the condition and the answer once, in sentences."""

from typing import Any

from gamekeeper.reporting.diagnosis_text import diagnosis_text

IDEAL = {
    "label": "perception",
    "intervention": "noise = 0",
    "kind": "ideal",
    "effect": 1.0,
    "low": 0.9,
    "high": 1.0,
    "p": 0.001,
    "n": 64,
    "measure": "success",
    "restores": True,
}
WORSE = {
    "label": "planning",
    "intervention": "policy[a_0] = noop",
    "kind": "perturbation",
    "effect": -1.5,
    "low": -2.0,
    "high": -1.0,
    "p": 0.001,
    "n": 50,
    "measure": "return",
    "depends": True,
    "flips_at": 0.5,
}
NOTHING = {"label": "control", "why": "slip is at its ideal"}


def _answer(**given: Any) -> dict[str, Any]:
    answer = {
        "answer": "isolated",
        "labels": ["perception"],
        "component": "a_0's perception",
        "why": "noise = 0 restores success, and no other ideal substitute that was played does",
        "scope": "team",
        "success": {"share": 0.0, "low": 0.0, "high": 0.06},
        "substitutes": ["noise = 0"],
        "tested": [IDEAL, WORSE],
        "not_tested": [NOTHING],
    }
    return {**answer, **given}


def _document(**given: Any) -> dict[str, Any]:
    document = {
        "run": "runs/x",
        "contradictions": {},
        "agents": {"a_0": _answer(), "b_0": _answer()},
        "team": _answer(),
        "recorded": {"team": {"failed": 9, "episodes": 10}},
        "fresh": {"team": {"failed": 64, "episodes": 64}},
        "counterfactuals": [],
        "expected": 0.9,
        "part": 0.7,
        "episodes": 300,
        "seed": 0,
        "conditions": {"team": "return < 1"},
        "most_episodes": 400,
        "not_played": [],
        "policies": {},
    }
    return {**document, **given}


def test_policies_of_the_new_episodes_are_named() -> None:
    """New episodes that another policy played aren't called unchanged."""
    text = " ".join(_text(policies={"a_0": "good.py:act"}).split())
    assert "with a_0 = good.py:act in place of the recorded policy" in text
    assert "with nothing changed" not in text


def _text(**given: Any) -> str:
    text = diagnosis_text(_document(**given), width=80)
    assert max(map(len, text.splitlines())) <= 80
    return " ".join(text.split())


def test_what_holds_for_all_agents_is_printed_once() -> None:
    """Answer, success rate, effects and labels that weren't tested."""
    text = _text()
    for once in (
        "The cause is perception (isolated): noise = 0 restores success",
        "Success rate of the new ones: 0% (95 % interval 0% to 6%)",
        "noise = 0 +1.00 (+0.90 to +1.00) restores",
        "control: slip is at its ideal",
        "policy[a_0] = noop -1.50 (-2.00 to -1.00) lower; most episodes fail from strength 0.5",
    ):
        assert text.count(once) == 1
    assert "a_0, b_0: as for the team." in text


def test_condition_and_counts_are_printed() -> None:
    """What counts as failed, and how many recorded and new episodes did."""
    text = _text()
    assert "An episode counts as failed if return < 1" in text
    assert "Failed: 9 of 10 recorded episodes, and 64 of 64 new ones with nothing changed" in text


def test_effects_say_what_changes() -> None:
    """The success rate with ideal substitutes, the team's return with perturbations."""
    text = _text()
    words = "the change of the success rate with its 95 % interval, each alone; +1.00: from 0%"
    assert words in text
    assert "the change of the team's mean return with its 95 % interval" in text


def test_agents_with_another_answer_say_so() -> None:
    """Only what differs from the team: the answer, and its own labels that weren't tested."""
    own = {"label": "perception", "why": "what could be made ideal isn't this agent's"}
    why = "what restores success is noise = 0, which isn't this agent's"
    other = _answer(
        answer="elsewhere", labels=[], component=None, why=why, not_tested=[own, NOTHING], tested=[]
    )
    text = _text(agents={"a_0": _answer(), "b_0": other})
    assert f"b_0: another agent's: {why}." in text
    assert "perception for b_0: what could be made ideal isn't this agent's" in text


def test_conditions_of_agents_have_a_block_each() -> None:
    """Equal blocks are one; the team's isn't there where no condition is the team's."""
    counts = {name: {"failed": 1, "episodes": 2} for name in ("a_0", "b_0")}
    text = _text(
        team=None,
        agents={name: _answer(scope=name) for name in counts},
        recorded=counts,
        fresh=counts,
        conditions={"agent": "battery < 1"},
    )
    assert "a_0, b_0 An episode counts as failed if battery < 1" in text
    assert text.count("The cause is perception") == 1
    assert "Team" not in text


def test_answers_are_sentences() -> None:
    """Causes, a whole policy without a label, and reasons why no cause is named."""
    both = ["perception", "control"]
    joint = _text(team=_answer(answer="joint", labels=both, why="together"))
    assert "The causes are perception and control together (joint): together." in joint
    either = _text(team=_answer(answer="ambiguous", labels=both, why="either"))
    assert "Possible causes: perception or control (ambiguous): either." in either
    policy = _text(team=_answer(labels=[], component="a_0's policy", why="swapped"), agents={})
    assert "The cause is a_0's policy (isolated): swapped." in policy
    words = {
        "healthy": "Healthy",
        "not_failing": "Not failing beyond chance",
        "unexplained": "Unexplained",
        "not_tried": "Not tried",
    }
    for answer, word in words.items():
        nothing = _answer(answer=answer, labels=[], component=None, why="none")
        assert f"{word}: none." in _text(team=nothing, agents={})


def test_counterfactuals_are_sentences() -> None:
    """Episodes with the same end share one, each with its first difference."""
    row = {
        "episode": 0,
        "intervention": "noise = 0",
        "turn": 3,
        "agent": "a_0",
        "field": "obs",
        "failed": True,
        "restored": True,
        "restored_open": False,
    }
    text = _text(counterfactuals=[row, {**row, "episode": 4, "turn": None}])
    assert (
        "with noise = 0: recorded episodes 0, 4 succeed; they still fail if all other agents "
        "repeat their recorded actions"
    ) in text
    assert "episode 0: first difference at turn 3, observation of a_0" in text
    assert "episode 4: no difference" in text


def test_what_the_budget_did_not_reach_is_printed() -> None:
    """With the option that raises it."""
    text = _text(not_played=["ideal substitutes: slip = 0"])
    assert "Not played (limit: 400; --episodes, --budget)" in text
    assert "ideal substitutes: slip = 0" in text
