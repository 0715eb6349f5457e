"""A diagnosis on one screen."""

import gamekeeper as gk
from gamekeeper.reporting.diagnosis_screen import diagnosis_screen


def test_screen_says_who_since_when_what_undoes_it_and_what_to_paste() -> None:
    """At most 24 lines of 80 columns, commands aside."""
    evidence = gk.rollout(
        "handover", policies="reference", episodes=2, env_kwargs={"latency": {"giver_0": 3}}
    )
    found = gk.diagnose(evidence, perturbations=False, episodes=300)
    document = found.to_json()
    assert document["agents"]["giver_0"]["since"] == {
        "episode": 0,
        "turn": found.counterfactuals[0].turn,
    }
    assert document["agents"]["receiver_0"]["since"] is None
    assert "gamekeeper" not in diagnosis_screen(document, width=80)
    lines = diagnosis_screen({**document, "run": "runs/x"}, width=80).splitlines()
    assert len(lines) <= 24
    assert any(line.startswith("Agent      giver_0 (isolated;") for line in lines)
    assert any(line.startswith("Repair     latency[giver_0] = 0") for line in lines)
    assert any("gamekeeper pivots runs/x --episode 0" in line for line in lines)
    given = {"--policy": ["a=x", "b=y z"], "--seed": 3, "--env": None, "--allow-import": True}
    typed = diagnosis_screen({**document, "run": "runs/x"}, width=80, options=given)
    words = "--failed 'undelivered > 0' --policy a=x --policy 'b=y z'"
    assert f"pivots runs/x --episode 0 {words} --allow-import   # a turn that saves it" in typed
    document["fresh"]["team"]["failed"] -= 1
    assert "# the turn that lost it" in diagnosis_screen({**document, "run": "x"}, width=80)
    assert f"diagnose runs/x {words} --seed 3 --allow-import --all" in typed
    assert "Others     receiver_0: no cause found in what was tried" in lines
    assert any(line.startswith("Effect     success rate from 0% to ") for line in lines)


def test_screen_of_a_healthy_run_accuses_no_agent() -> None:
    """It says that none is, and asks for no run that worked."""
    evidence = gk.rollout("handover", policies="reference", episodes=2)
    text = diagnosis_screen(gk.diagnose(evidence, perturbations=False).to_json(), width=80)
    assert "Agent      none. Healthy:" in text
    assert "--good" not in text


def test_screen_says_what_is_striking_where_no_agent_alone_is_named() -> None:
    """Facts of the response tests, such as a policy that reacts to nothing."""
    evidence = gk.rollout("handover", policies="reference", episodes=2)
    document = gk.diagnose(evidence, perturbations=False).to_json()
    plain = {"changes": 9, "reactions": 5, "lag": 0, "randomness": 0.0}
    plain |= {"is_repeatable": True, "text": "reacts at once"}
    deaf = {**plain, "reactions": 0, "lag": None, "text": "reacts to no change"}
    text = diagnosis_screen({**document, "responses": {"a_0": plain, "b_0": deaf}}, width=80)
    assert "Noted      b_0 reacts to no change" in text
    assert "a_0 reacts" not in text


def test_screen_shows_a_change_of_each_label_that_it_names_and_counts_the_rest() -> None:
    """A label whose change came fourth would stand there without one."""
    tests = [
        {
            "label": label,
            "intervention": f"change {at}",
            "restores": True,
            "effect": 1.0,
            "low": 0.9,
        }
        | {"high": 1.0, "p": 0.0, "n": 64}
        for at, label in enumerate(["perception"] * 4 + ["control"])
    ]
    names = [each["intervention"] for each in tests]
    one = {"answer": "ambiguous", "labels": ["perception", "control"], "component": "either"}
    one |= {"tested": tests, "substitutes": names, "why": "", "success": None, "beside": []}
    document = {"agents": {"a": one}, "team": None, "run": "memory", "counterfactuals": []}
    document |= {"not_played": [], "conditions": {}, "episodes": 9, "reused": 0, "seed": 0}
    document |= {"most_episodes": 9, "budget": None, "steps": 9, "contradictions": {}}
    lines = diagnosis_screen(document, width=80).splitlines()
    start = lines.index("Repair     change 0")
    shown = [line.strip() for line in lines[start + 1 : start + 4]]
    assert shown == ["change 4", "change 1", "and 2 more"]
    silent = {
        **one,
        "answer": "unexplained",
        "labels": [],
        "substitutes": [],
        "why": "nothing does",
    }
    document |= {"run": "runs/x", "agents": {"a": silent}}
    typed = "gamekeeper diagnose runs/x --try AGENT=POLICY   #"
    assert typed in diagnosis_screen(document, width=80)
    again = diagnosis_screen(document, width=80, options={"--try": ["a=x"]})
    assert typed not in again
    assert "runs/x --try a=x --all" in again
