"""An attribution as text: what is found is said, what isn't leaves no heading."""

from gamekeeper.reporting.attribution_text import attribution_text


def _measured(value, half=1.0):
    low, high = (None, None) if half is None else (value - half, value + half)
    return {"value": value, "low": low, "high": high, "p": 0.1, "n": 50, "baseline": "noop"}


def _agent(**given):
    part = {
        "return": 2.0,
        "terms": {},
        "share": 0.5,
        "idle": None,
        "difference": _measured(3.0),
        "turn": {"all": None, "one": None},
        "shapley": _measured(4.0, None),
        "lazy": False,
        "lazy_why": "it works",
        "fair_share": 4.0,
    }
    return {**part, **given}


def _document(**given):
    document = {
        "run": "runs/x",
        "episodes": 2,
        "fresh": 50,
        "recorded": 20,
        "replayed": 5,
        "loop": "closed",
        "policies": {},
        "baseline": "noop",
        "team": {"all": 9.0, "none": 1.0, "shapley": "exact"},
        "agents": {"a_0": _agent()},
        "influence": [],
        "messages": [],
        "penalties": [],
        "not_tested": [],
    }
    return {**document, **given}


def test_attribution_text_has_intervals_and_counts() -> None:
    """An interval where there is one, else how many episodes; a dash for what isn't known."""
    turn = {"one": _measured(1.0), "all": None}
    text = attribution_text(_document(agents={"a_0": _agent(turn=turn)}), width=80)
    assert "a_0    2           50%    -" in text
    assert "a_0    3 (2 to 4)  4 (n = 50)" in text
    assert "a_0    1 (0 to 2)  -" in text
    assert "return is 9" in text
    assert not any(word in text for word in ("Lazy", "Influence", "Penalties", "Not tested"))


def test_attribution_text_says_which_policies_the_new_episodes_play() -> None:
    """Policies that were named in place of the recorded ones stand in the title of the table."""
    text = attribution_text(_document(policies={"picker": "random"}), width=200)
    assert "50 new episodes, with picker = random in place of what was recorded" in text
    assert "in place of" not in attribution_text(_document(), width=200)


def test_attribution_text_has_a_group_for_each_way_of_measuring() -> None:
    """Recorded, with agents replaced, with actions replaced; each with its episodes and words."""
    turn = {"one": _measured(1.0), "all": _measured(2.0)}
    text = attribution_text(_document(agents={"a_0": _agent(turn=turn)}), width=80)
    recorded, agents, actions = text.split("\n\n")
    assert recorded.startswith("Recorded run: 20 episodes, nothing replaced")
    assert "own return:" in recorded
    assert "idle -: no noop is declared" in recorded
    assert "share -" not in recorded
    assert agents.startswith("Agents replaced, several sets of them in each: 50 new episodes")
    assert "difference: mean team return that is lost if the baseline plays" in agents
    assert "Shapley value: what the agent adds" in agents
    assert "n: number of episodes; a confidence interval needs at least 50" in agents
    assert "2 recorded and 3 new episodes" in " ".join(actions.split())
    assert "one action  all actions" in actions
    assert "1 (0 to 2)  2 (1 to 3)" in actions
    assert "own return" not in agents + actions


def test_attribution_text_tells_what_was_found() -> None:
    """Lazy agents, wrong penalties, influence, messages and gaps each have a line."""
    row = {"from": "a_0", "to": "b_0", "on": "reward", "lag": 1, "p": 0.5, "low": 0.4, "high": 0.6}
    first = {"episode": 3, "seed": 7, "turn": 5, "paid": -0.25, "causers": ["b_0"]}
    wrong = {
        "agent": "a_0",
        "term": "bump",
        "p": 0.5,
        "low": 0.2,
        "high": 0.8,
        "n": 6,
        "unknown": 0,
        "by": {"b_0": 3},
        "first": first,
    }
    said = [
        {
            "kind": "listening",
            "from": None,
            "to": "b_0",
            "p": 0.9,
            "low": 0.8,
            "high": 1.0,
            "unchanged": 0.0,
            "n": 40,
        },
        {"kind": "signalling", "from": "a_0", "to": None, "bits": 1.5, "p": 0.005, "n": 50},
        {"kind": "coordination", "from": "a_0", "to": "b_0", "bits": 0.5, "p": 0.005, "n": 50},
    ]
    text = attribution_text(
        _document(
            agents={"a_0": _agent(lazy=True, lazy_why="it waits")},
            influence=[{**row, "n": 90}],
            penalties=[wrong, {**wrong, "first": None}],
            messages=said,
            not_tested=[{"what": "this", "why": "that"}],
        ),
        width=100,
    )
    assert "a_0: it waits" in text
    assert "a_0   b_0  reward  1            50% (40% to 60%)  90" in text
    assert text.count("a_0 gets bump for actions of b_0") == 1
    assert "first in episode 3 (seed 7), turn 5: -0.25" in " ".join(text.split())
    assert "b_0 acts differently in 90% of 40 tests" in text
    assert "a_0's messages have 1.50 bits" in text
    assert "this: that" in text


def test_attribution_text_says_that_nobody_could_react() -> None:
    """Without policies there is no return of all and none."""
    team = {"all": None, "none": None, "shapley": None}
    text = attribution_text(_document(team=team, loop="open"), width=80)
    assert "no policies that could react" in text


def test_attribution_text_says_that_fresh_episodes_were_not_asked_for() -> None:
    """Where policies could react, it isn't the run that lacks them."""
    team = {"all": None, "none": None, "shapley": None}
    text = attribution_text(_document(team=team, fresh=0), width=80)
    assert "no policies" not in text
    assert "--episodes is 0" in text
