from typing import Any

from gamekeeper.contract import Contract
from gamekeeper.contract.toml import Question
from gamekeeper.reporting.changes_text import changes_text
from gamekeeper.reporting.influence_text import influence_text
from gamekeeper.reporting.measured_draft import draft_note, measured_questions
from gamekeeper.reporting.measured_text import measured_text, words
from tests.reporting.audits import audit

MEASURED: dict[str, Any] = {
    "stages": [["rover", "base"]],
    "order": "none",
    "order_sensitive": "none",
    "order_ticks": 1_036,
    "deterministic": True,
    "horizon": 20,
    "symmetric": {"rover": {"seems": True, "p": 0.52, "n": 24}},
    "reward": {"shared": False, "by_agent": {"rover_0": {"mean_return": 0.5, "positive": 3}}},
    "endings": {"episodes": 8, "by_agent": {"rover_0": {"terminated": 5}}},
    "influence": [],
    "advice": "parallel",
    "why": "in 518 ticks another order changed nothing",
}
DECLARED = {
    "schedule": {"horizon": 25, "order": "none"},
    "roles": {"rover": {"symmetric": True}},
    "rewards": {"sample": {"kind": "individual"}},
}


def influence(one: str, two: str, on: str, lag: int, p: float) -> dict[str, Any]:
    """One measured influence."""
    return {"from": one, "to": two, "on": on, "lag": lag, "p": p, "low": 0, "high": 1, "n": 5}


def test_measured_stands_beside_declared() -> None:
    """A row for each measured field, the declaration at its right; differences are marked."""
    text = measured_text(audit(measured=MEASURED, declared=DECLARED), width=80)
    rows = {line[2:26].strip(): line for line in text.splitlines()}
    assert rows["horizon"].split() == ["horizon", "20", "25", "(differs)"]
    assert rows["order"].split() == ["order", "none", "none"]
    assert rows["deterministic by its see"].endswith("not declared")
    assert rows["symmetric"].split("  ")[-1].strip() == "rover: yes"
    assert rows["reward"].endswith("sample (individual)")
    assert "AEC or Parallel\n  Parallel fits: in 518 ticks" in text
    assert "no difference seen in" in rows["order of actions matters"]
    alone = measured_text(audit(measured=MEASURED), width=80)
    assert alone.startswith("Measured (nothing is declared)\n  stages")
    assert "not declared" not in alone


def test_unmeasured_fields_share_a_row() -> None:
    """Fields with neither a measurement nor a declaration are named in one row."""
    found = {**MEASURED, "observe": None, "conflicts": None, "horizon": None}
    lines = measured_text(audit(measured=found, declared=DECLARED), width=110).splitlines()
    (row,) = [line for line in lines if line.startswith("  not measured")]
    assert "observe, conflicts (reasons: --json)" in row
    assert any(line.split()[:3] == ["horizon", "not", "measured"] for line in lines)


def test_measured_values_are_sentences() -> None:
    """A reader who knows PettingZoo needs no key: who acts with whom, what was paid, what ended."""
    found = {key: words(MEASURED[key]) for key in ("order", "symmetric", "reward", "endings")}
    assert found == {
        "order": "none",
        "symmetric": "rover: seems so, permutation test, p = 0.52, 24 episodes",
        "reward": "not the same for all agents",
        "endings": "0 of 8 episodes ended by themselves",
    }
    paid = {"shared": True, "zero_sum": False, "n": 1_193}
    assert words(paid).endswith(
        "doesn't sum to 0 over them; 1,193 env steps had a reward other than 0"
    )
    said = {"message": True, "to": ["rover"], "n": 40}
    assert words(said) == "its action is a message to rover (40 comparisons)"
    ended = {"episodes": 9, "ended": 8, "ticks": {"least": 3, "median": 4, "most": 25}}
    assert words(ended) == "8 of 9 episodes ended by themselves, after 3 to 25 (median 4) ticks"
    kinds = [{"kind": "truncation", "owner": "all", "seen": 7}]
    of_both = {**ended, "kinds": kinds, "by_agent": {"a": {"terminated": 1, "truncated": 7}}}
    assert words(of_both).startswith("truncation of all, termination (owner not measured): 8 of 9")
    other = {**of_both, "by_agent": {"a": {"terminated": 8, "truncated": 0}}}
    assert words(other).startswith("truncation of all (in other episodes), termination (owner")


def test_legends_explain_ticks_and_p_values() -> None:
    """Below the table stands what a tick and the p-value of symmetry are."""
    text = " ".join(measured_text(audit(measured=MEASURED), width=80).split())
    assert "tick: one step in which every live agent acts once." in text
    assert "0.01 or less counts as no" in text


def test_agents_have_a_table_of_their_own() -> None:
    """What was measured by agent is one table, its figures at the right."""
    lines = measured_text(audit(measured=MEASURED), width=80).splitlines()
    place = lines.index("Measured by agent")
    assert lines[place + 1].split() == ["agent", "mean", "return", "terminated"]
    assert lines[place + 2].split() == ["rover_0", "0.5", "5"]


def test_nothing_measured_is_no_text() -> None:
    """An audit of a few checks measures nothing, and shows nothing of it."""
    assert measured_text(audit(), width=80) == ""


def test_influence_has_a_row_for_each_pair_and_effect() -> None:
    """The first lag of each; an agent's effect on itself and none at all are left out."""
    found = [
        influence("a", "a", "observation", 0, 1.0),
        influence("a", "b", "reward", 0, 0.1),
        influence("a", "b", "reward", 1, 0.625),
        influence("b", "a", "ending", 0, 0.0),
    ]
    lines = influence_text(found, width=80, lag="rounds").splitlines()
    start = next(place for place, line in enumerate(lines) if line.startswith("  from"))
    assert lines[start + 1].split() == ["a", "b", "reward", "0", "10%", "(0%", "to", "100%)", "5"]
    assert lines[start + 2].startswith("  rounds later: rounds (one turn of every live agent) from")
    assert influence_text(found[:1], width=80, lag="steps") == ""


def test_influence_is_shown_at_its_first_lag() -> None:
    """A later lag at which 1 of 2 tries changed something gives way to the first of all."""
    lucky = influence("a", "b", "reward", 3, 0.5) | {"low": 0.01, "n": 2}
    found = [lucky, influence("a", "b", "reward", 1, 0.4) | {"low": 0.3, "n": 100}]
    rows = [
        influence_text(each, width=80, lag="steps").split("steps later:")[0]
        for each in (found, found[:1])
    ]
    assert ["40%" in rows[0], "50%" in rows[0], "50%" in rows[1]] == [True, False, True]


def test_influence_of_many_agents_is_cut() -> None:
    """Of 132 pairs twelve are shown, and the others counted."""
    names = [f"agent_{k}" for k in range(12)]
    found = [influence(one, two, "reward", 0, 0.5) for one in names for two in names]
    text = influence_text(found, width=80, lag="rounds")
    assert sum(line.startswith("  agent_") for line in text.splitlines()) == 12
    assert "and 120 more" in text


def test_values_are_said_as_readers_say_them() -> None:
    """Truth values, nested tables, lists; names of agents stay as they are."""
    assert words(True) == "yes"
    assert words({"agent_0": [1, 2.5], "empty": None}) == "agent_0: (1, 2.5)"
    assert words({"seems": False, "p": 0.001}) == "seems not, permutation test, p = 0.001"


def test_draft_proposes_what_was_measured_and_declares_nothing() -> None:
    """Measured answers stand as comments, so a contract read from the draft has none of them."""
    contract = Contract(name="rovers_v0", api="parallel")
    questions = (
        Question(("schedule", "horizon"), "after how many ticks?", "N"),
        Question(("seeds", "deterministic"), "the same rollout?", "true | false"),
        Question(("roles", "rover", "symmetric"), "interchangeable?", "true | false"),
        Question(("why",), "why?", '"…"'),
        Question(("infos", "x"), "what?", "…"),
    )
    near = {**MEASURED, "near_limits": {"max_steps": 21}}  # one of the two is a mistake
    (limit, *_) = measured_questions(questions, near)
    assert (limit.measured, limit.hint) == ("", "measured: 20, though max_steps is 21")
    asked = measured_questions(questions, MEASURED)
    assert [each.measured for each in asked[:3]] == ["20", "true", ""]
    assert asked[2].hint == "measured: seems so, permutation test, p = 0.52, 24 episodes"
    assert "in 518 ticks" in asked[3].hint
    assert asked[4] == questions[4]
    text = draft_note(steps=3_000, seed=0) + contract.to_toml(asked)
    assert "# horizon = 20" in text
    assert Contract.parse(text) == contract


def test_draft_takes_over_the_form_only_where_it_was_measured() -> None:
    """Fields in a contract's words are proposed; silence proposes nothing."""
    questions = tuple(
        Question(path, "which?", "X")
        for path in (
            ("schedule", "stages"),
            ("schedule", "order"),
            ("schedule", "observe"),
            ("schedule", "conflicts"),
            ("roles", "rover", "may_join"),
            ("roles", "rover", "may_leave"),
        )
    )
    form = {
        "stages": [["rover"]],
        "order": "rotating",
        "observe": "after turn",
        "conflicts": "ordered",
        "may_join": ["rover"],
        "may_leave": [],
    }
    answers = [each.measured for each in measured_questions(questions, form)]
    assert answers == ['[["rover"]]', '"rotating"', '"after turn"', '"ordered"', "true", ""]
    silent: dict[str, Any] = dict.fromkeys(form)
    silent |= {"order_sensitive": "none", "stages": [["truck"]]}
    asked = measured_questions(questions, silent)
    assert [each.measured for each in asked] == [""] * 6
    assert [each.hint for each in asked[:2]] == ["", ""]


def test_changes_stand_by_kind() -> None:
    """What it was and what it is now; of promises what broke first."""
    changes = [
        {"kind": "spaces", "where": "a.action_space", "a": "Discrete(3)", "b": "Discrete(4)"},
        {"kind": "verdicts", "where": "GK1 Fixed.", "a": "failed", "b": "passed"},
        {"kind": "verdicts", "where": "GK2 Broke.", "a": "passed", "b": "failed"},
        {"kind": "roster", "where": "agents", "a": None, "b": ["late_0"]},
    ]
    assert changes_text(changes, width=80) == (
        "Agents\n  agents  not there -> late_0\n\n"
        "Spaces\n  a.action_space  Discrete(3) -> Discrete(4)\n\n"
        "Checks\n  passed -> failed  GK2 Broke.\n  failed -> passed  GK1 Fixed."
    )
    assert changes_text([], width=80) == ""
