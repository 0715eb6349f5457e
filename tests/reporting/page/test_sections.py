"""What sections say of figures: intervals, learning by version, comparisons, evaluation."""

import json
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.reporting.page.agent_section import FEWEST, Mean, agents_blocks, mean_of
from gamekeeper.reporting.page.audit_sections import (
    MOST_AGENTS,
    form_of_run,
    form_section,
    influence_blocks,
    verdicts_section,
)
from gamekeeper.reporting.page.episode_figures import Figures, compared_block, figures_of
from gamekeeper.reporting.page.evaluation_section import evaluation_section
from gamekeeper.reporting.page.learning_section import learning_section, phases_of
from gamekeeper.reporting.page.packed_episode import packed_agents
from gamekeeper.reporting.page.page_data import (
    MOST_POINTS,
    PageSection,
    PageTable,
    binned_line,
    forest,
    matrix,
    number,
    shown,
)
from gamekeeper.reporting.page.page_html import commands
from gamekeeper.statistics.one_sample import one_sample
from tests.reporting.page import documents
from tests.reporting.page.games import PLAIN, recorded


def rng() -> np.random.Generator:
    """The same draws every time."""
    return np.random.default_rng(0)


def played(returns: dict[str, list[float]], versions: list[dict[str, str]]) -> Figures:
    """Figures of a run in which each episode names its policies' versions."""
    columns = np.array(list(returns.values()), np.float64).T
    flags = np.zeros(columns.shape, np.bool_)
    headers = tuple(
        {
            "episode": number,
            "seed": number,
            "policies": json.dumps(
                {agent: {"policy": "net", "version": each} for agent, each in version.items()}
            ),
        }
        for number, version in enumerate(versions)
    )
    return Figures(headers, tuple(returns), ~flags, columns, columns, {}, flags, flags, columns)


def tables(section: PageSection) -> dict[str, PageTable]:
    """The tables of a section by caption."""
    return {table.caption: table for block in section.shown for table in block.tables if table}


def words(table: PageTable) -> list[list[str]]:
    """The texts of a table's cells."""
    return [[cell.text for cell in row] for row in table.rows]


def test_no_interval_below_fifty_episodes() -> None:
    """Fewer have a mean alone; from fifty on the interval is that of an evaluation."""
    values = rng().normal(3, 1, FEWEST)
    assert Mean(float(values[:-1].mean()), None, None, FEWEST - 1) == mean_of(values[:-1], rng())
    found, expected = mean_of(values, rng()), one_sample(values, rng=rng())
    assert (expected.low, expected.high) == (found.low, found.high)
    assert Mean(None, None, None, 0) == mean_of(np.empty(0), rng())


def test_learning_follows_versions() -> None:
    """A phase ends where a version changes; agents that kept theirs changed by the others."""
    many = FEWEST + FEWEST % 2
    figures = played(
        {"a": [1.0] * many + [2.0, 3.0] * (many // 2), "b": [0.0] * many + [5.0] * many},
        [{"a": "1", "b": "1"}] * many + [{"a": "1", "b": "2"}] * many,
    )
    one, two = phases_of([("a", figures)])
    assert [(0, many - 1), (many, 2 * many - 1)] == [(each.first, each.last) for each in (one, two)]
    assert [frozenset(), frozenset({"b"})] == [one.changed, two.changed]
    section = learning_section([("a", figures)], rng())
    moved = words(tables(section)["Changed by others' learning"])
    assert [["a", f"a: {many} to {2 * many - 1}", "b", "1.5"]] == [row[:4] for row in moved]
    assert "to" in moved[0][4]
    (chart,) = (chart for block in section.shown for chart in block.charts)
    assert {s["name"]: s["values"] for s in chart["series"]} == {"a": [1.0, 2.5], "b": [0.0, 5.0]}


def test_one_version_is_no_learning() -> None:
    """Where nothing changed its version nothing is shown but that."""
    figures = played({"a": [1.0, 2.0]}, [{"a": "1"}] * 2)
    assert learning_section([("a", figures)], rng()) is None


def test_learning_goes_on_over_runs() -> None:
    """Runs follow one another, each with a mark where it starts."""
    runs = [(key, played({"a": [1.0, 2.0]}, [{"a": key}] * 2)) for key in "ab"]
    (chart,) = (c for block in learning_section(runs, rng()).shown for c in block.charts)
    assert chart["marks"] == [{"x": 1, "text": "run b"}]


def test_runs_are_compared_on_the_same_seeds() -> None:
    """Differences are over shared seeds, with an interval where there are fifty."""
    base = played({"a": list(rng().normal(0, 1, 60)), "old": [0.0] * 60}, [{}] * 60)
    other = played({"a": list(rng().normal(0, 1, 60) + 2), "new": [0.0] * 60}, [{}] * 60)
    block = compared_block(base, other, names=("x", "y"), rng=rng())
    ((agent, *_, pairs, difference, bounds),) = words(block.tables[0])
    assert (agent, pairs, difference, bounds) == ("a", "60", "2", "2 to 2")
    assert "old, new" in block.notes[0]


@pytest.mark.parametrize("spec", ["aec:tictactoe", "warehouse", "aec:connect_four"])
def test_form_of_a_run_alone_is_what_was_seen(spec: str) -> None:
    """Without an audit API, order, roster and endings stand there as the run shows them."""
    evidence = gk.rollout(spec, episodes=3, most_turns=40)
    figures = figures_of(evidence)
    seen = form_of_run(evidence, figures)
    is_aec = spec.startswith("aec")
    assert seen["order"] == ("fixed" if is_aec else "none")
    section = form_section(evidence, figures, packed_agents(evidence), audit=None, attribution=None)
    told = tables(section)
    assert len(figures.agents) <= len(told["Agents and spaces"].rows)
    assert "declared" in told["Declared beside measured"].columns


def test_crowd_has_its_outliers_first_and_equal_spaces_once() -> None:
    """Of many agents sixteen rows are shown, all of them folded; equal spaces have one row."""
    evidence = gk.rollout("pursuit", env_kwargs={"pursuers": 20}, episodes=2)
    figures, roster = figures_of(evidence), packed_agents(evidence)
    options = {"labels": (), "attribution": None, "failed": [], "condition": "", "rng": rng()}
    blocks = agents_blocks(figures, evidence.summary, roster, key="a", **options)
    folded = [block for block in blocks if block.folded]
    assert len(blocks[0].tables[0].rows) == 16
    assert [len(block.tables[0].rows) for block in folded] == [len(figures.agents)]
    section = form_section(evidence, figures, roster, audit=None, attribution=None)
    rows = words(tables(section)["Agents and spaces"])
    assert len(rows) < len(figures.agents)
    assert "and " in rows[0][0]


def test_audit_of_another_environment_is_told() -> None:
    """An audit that knows none of the run's agents raises an alert."""
    evidence = recorded()
    figures, roster = figures_of(evidence), packed_agents(evidence)
    for agents, expected in ((PLAIN, 0), (("x", "y"), 1)):
        audit = documents.audit("w", agents)
        section = form_section(evidence, figures, roster, audit=audit, attribution=None)
        assert expected == len(section.blocks[0].alerts)


def test_influence_shows_the_first_lag_or_the_strongest_pairs() -> None:
    """A matrix by kind; in large rosters the strongest pairs alone."""
    row: dict[str, Any] = {"on": "reward", "low": 0.0, "high": 1.0, "n": 9}
    rows = [{**row, "from": "a", "to": "b", "lag": lag, "p": p} for lag, p in ((0, 0.0), (2, 0.7))]
    matrices, every = influence_blocks(rows, "so", lag="turns")
    (chart,) = matrices.charts
    assert chart["values"] == [[None, 0.7], [None, None]]
    assert chart["texts"][0][1] == "70% +2 (0% to 100%)"
    assert every.folded
    many = [
        {**row, "from": f"a{k}", "to": f"a{k}", "lag": 0, "p": 0.5} for k in range(MOST_AGENTS + 1)
    ]
    (block,) = influence_blocks(many, "so", lag="rounds")
    assert (0, "more were measured" in block.tables[0].note) == (len(block.charts), True)


def test_verdicts_stand_by_severity() -> None:
    """Broken ones first, the worst of them first; a check that failed itself follows."""
    audit = documents.audit("w", PLAIN)
    audit["verdicts"].append({**audit["verdicts"][0], "id": "GK001", "outcome": "error"})
    found = verdicts_section(audit).verdicts
    assert found is not None
    assert [each["id"] for each in found.bad] == ["GK402", "GK101", "GK001"]
    assert [cell.text for cell in found.summary] == [
        "2 failed",
        "1 error",
        "1 not exercised",
        "1 passed",
    ]
    anchors = [finding["anchor"] for each in found.bad for finding in each["findings"]]
    assert len(set(anchors)) == len(anchors)


def test_evaluation_shows_the_crossplay_matrix() -> None:
    """Rows and columns are the policies of the two roles; a role's own mean stands beside."""
    section = evaluation_section(documents.evaluation("w", PLAIN))
    matrices = [c for block in section.shown for c in block.charts if c["kind"] == "matrix"]
    assert [(c["rows"], c["columns"]) for c in matrices] == [(["w", "other"], ["w", "other"])]
    assert matrices[0]["values"] == [[2.0, 6.0], [6.0, 10.0]]
    assert {"Pairings", "Fairness"} <= set(tables(section))


def test_commands_quote_what_evidence_names() -> None:
    """A folder's name can't smuggle a command into a line that is copied."""
    evidence = recorded()
    lines = commands(evidence, "runs/x; rm -rf ~\nrm y", None)
    assert "gamekeeper replay 'runs/x; rm -rf ~\\nrm y'" in lines
    assert all("\n" not in line for line in lines)


def test_commands_record_the_same_again() -> None:
    """Of an environment that has a name, the line that records it anew, with seed and policy."""
    evidence = gk.rollout("two_robot_line", episodes=2, seed=7, env_kwargs={"latency": 1})
    lines = commands(evidence, "runs/line", {"seed": 3})
    assert any(
        line.startswith("gamekeeper rollout parallel:gamekeeper/two_robot_line-v0")
        and "--seed 7" in line
        and "--policy random" in line
        and "latency" in line
        for line in lines
    )
    assert any(line.endswith("--seed 3") and "audit" in line for line in lines)


def test_charts_bound_their_points() -> None:
    """Of many episodes means are drawn, with the range that they stand for."""
    count = MOST_POINTS * 3
    chart = binned_line("x", "t", range(count), {"a": np.arange(count, dtype=np.float64)})
    assert len(chart["x"]["values"]) == MOST_POINTS
    assert (chart["series"][0]["values"][0], chart["note"][:19]) == (1.0, "Means of 3 episodes")
    json.dumps(chart, allow_nan=False)


def test_charts_hold_only_finite_numbers() -> None:
    """NaN and infinities are gaps."""
    drawn = forest("f", "t", [{"name": "a", "value": np.nan, "low": -np.inf, "high": 1}], label="x")
    assert {"value": None, "low": None, "high": 1.0}.items() <= drawn["rows"][0].items()
    cells = matrix("m", "t", ["a"], ["b"], [[np.inf]], labels=("r", "c"))
    assert cells["values"] == [[None]]
    json.dumps([drawn, cells], allow_nan=False)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (None, "-"),
        (float("nan"), "-"),
        (3.0, "3"),
        (1234567.0, "1,234,567"),
        (0.12345, "0.123"),
        (12345.6, "12,346"),
        (1e12, "1e+12"),
        (-0.5, "-0.5"),
    ],
)
def test_numbers_are_short(value: float | None, expected: str) -> None:
    """Three digits, whole numbers whole, a dash for none."""
    assert expected == shown(value) == number(value).text
