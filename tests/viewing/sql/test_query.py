"""SQL over runs: what the views say, and which runs they are about."""

import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from gamekeeper.errors import GamekeeperError, RunError
from gamekeeper.runs.files.schema import STREAMS
from tests.runs import run_folders
from tests.viewing.sql.left_open import left_open

pytest.importorskip("duckdb")

from gamekeeper.viewing.sql import Session, query


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three runs of three environments, whose columns differ."""
    folder = tmp_path_factory.mktemp("runs")
    for name, episodes in (("two_robot_line", 3), ("handover", 2), ("spread", 1)):
        gk.rollout(name, episodes=episodes, seed=4, out=folder / name)
    return folder


def rows(*line: Any) -> list[dict[str, Any]]:
    """The rows of a query as plain data."""
    found: list[dict[str, Any]] = query(*line).to_pylist()
    return found


def test_returns_are_those_of_the_summary(runs: Path) -> None:
    """Mean return, mean length and role of every agent, whatever the run's columns are."""
    sql = """
        select run, agent, any_value(role) as role, avg("return") as mean, avg(length) as length
        from returns group by run, agent
    """
    found = {(Path(row["run"]).name, row["agent"]): row for row in rows(runs, sql)}
    assert len(found) == 2 + 2 + 3
    for name in ("two_robot_line", "handover", "spread"):
        evidence = gk.load(runs / name)
        for agent, summary in evidence.summary.agents.items():
            row = found[name, agent]
            assert row["mean"] == pytest.approx(summary.return_mean, abs=1e-9)
            assert row["length"] == pytest.approx(summary.length_mean)
            assert row["role"] == evidence.contract.role_of(agent)


def test_returns_tell_terms_of_those_who_have_them(runs: Path) -> None:
    """A run without a term has null there, not 0; terms add up to the return."""
    sql = "select * from returns order by run, episode, agent"
    for row in rows(runs, sql):
        terms = {name: value for name, value in row.items() if name.startswith("reward.")}
        has = {name for name, value in terms.items() if value is not None}
        of_run = {f"reward.{each}" for each in gk.load(row["run"]).manifest["terms"]}
        assert has == of_run
        assert sum(terms[name] for name in has) == pytest.approx(row["return"])


def test_endings_are_counted_as_in_the_summary(runs: Path) -> None:
    """The reason that the rules gave, for every agent and episode."""
    sql = "select run, agent, reason, count(*) as n from endings group by all"
    found: dict[tuple[str, str], dict[str, int]] = {}
    for row in rows(runs, sql):
        found.setdefault((Path(row["run"]).name, row["agent"]), {})[row["reason"]] = row["n"]
    for name in ("two_robot_line", "handover", "spread"):
        for agent, summary in gk.load(runs / name).summary.agents.items():
            assert found[name, agent] == summary.endings


def test_endings_name_the_turn_and_the_flag(runs: Path) -> None:
    """An agent ends at the first row that says so; terminated and truncated stay apart."""
    evidence = gk.load(runs / "two_robot_line")
    found = rows(runs / "two_robot_line", "select * from endings where episode = 0 order by agent")
    episode = evidence.episode(0)
    last = max(episode.steps["turn"].to_pylist())
    assert [(row["agent"], row["turn"]) for row in found] == [("carrier", last), ("picker", last)]
    assert all(row["terminated"] and not row["truncated"] for row in found)


def test_orders_say_who_acted_when(runs: Path) -> None:
    """One row for each action; the name `order` wants quotes."""
    steps = gk.load(runs / "handover").agent_steps
    acted = steps.num_rows - steps["order"].null_count
    sql = "select count(*) as n from orders where run like '%handover'"
    assert rows(runs, sql) == [{"n": acted}]
    assert rows(runs, "select count(*) as n from \"order\" where run like '%handover'") == [
        {"n": acted}
    ]


def test_labels_are_those_of_the_annotations(runs: Path, tmp_path: Path) -> None:
    """Where, whose, what, by whom; a run without any adds none."""
    from gamekeeper.diagnosis.labels import label

    run = tmp_path / "run"
    shutil.copytree(runs / "two_robot_line", run)
    label(run, "timing", agent="picker", episode=1, turn=2, why="late", by="ann")
    label(run, "control", by="ann")
    found = rows(run, runs / "handover", "select * exclude (said_at) from labels order by label")
    assert found == [
        {
            "run": run.as_posix(),
            "episode": None,
            "turn": None,
            "agent": None,
            "label": "control",
            "why": "",
            "said_by": "ann",
            "proposed": False,
        },
        {
            "run": run.as_posix(),
            "episode": 1,
            "turn": 2,
            "agent": "picker",
            "label": "timing",
            "why": "late",
            "said_by": "ann",
            "proposed": False,
        },
    ]


def test_streams_are_there_as_they_were_recorded(runs: Path) -> None:
    """All rows, with the column `run`; what a run's columns lack is null."""
    for stream in STREAMS:
        count = sum(
            table.num_rows
            for name in ("two_robot_line", "handover", "spread")
            if (table := gk.load(runs / name).tables.table(stream)) is not None
        )
        assert rows(runs, f"select count(*) as n from {stream}") == [{"n": count}]
    sql = (
        "select distinct \"reward.meeting\" is null as no from agent_steps where run like '%spread'"
    )
    assert rows(runs, sql) == [{"no": True}]


def test_runs_tell_what_manifests_say(runs: Path) -> None:
    """Environment, seed, status and fingerprint of each."""
    found = rows(runs, "select * from runs order by run")
    assert [row["environment"] for row in found] == [
        "handover_v0",
        "spread_v0",
        "two_robot_line_v0",
    ]
    assert {row["fingerprint"] for row in found} == {
        gk.load(runs / name).fingerprint for name in ("two_robot_line", "handover", "spread")
    }
    assert {(row["seed"], row["status"]) for row in found} == {(4, "finalized")}


def test_columns_of_two_kinds_stand_as_text(tmp_path: Path) -> None:
    """A number here and a list there share a column as text; numbers of all sorts are doubles."""
    for name, action, obs in (
        ("a", pa.array([1], pa.int64()), pa.array([[2**30 + 1]], pa.list_(pa.int64()))),
        ("b", pa.array([[1.5, 2.0]]), pa.array([[0.5]], pa.list_(pa.float32()))),
    ):
        run_folders.finalized_run(tmp_path / name)
        path = tmp_path / name / "agent_steps.parquet"
        steps = pq.read_table(path).slice(0, 1).drop_columns(["obs"])
        pq.write_table(steps.append_column("action", action).append_column("obs", obs), path)
    found = rows(tmp_path, "select action, obs from agent_steps order by run")
    assert found == [{"action": "1", "obs": [2.0**30 + 1]}, {"action": "[1.5, 2.0]", "obs": [0.5]}]


def test_open_and_killed_runs_are_read_up_to_their_last_turn(runs: Path, tmp_path: Path) -> None:
    """Beside finalized ones, in the same views."""
    left = left_open(runs / "handover", tmp_path / "left")
    whole = gk.load(left)
    assert whole.manifest["status"] == "open"
    sql = "select run, count(*) as n from {} where run like '%left' group by run"
    for stream in STREAMS:
        found = rows(left, runs / "spread", sql.format(stream))
        assert found == [{"run": left.as_posix(), "n": whole.tables.table(stream).num_rows}]
    lists = rows(left, runs / "spread", "select distinct typeof(obs) as t from agent_steps")
    assert lists == [{"t": "DOUBLE[]"}]


def test_columns_of_our_own_need_no_quotes(runs: Path) -> None:
    """None of their names is a word of SQL."""
    with Session.of(runs) as session:
        for view in ("runs", "agents", "labels", "endings", "returns"):
            names = [name for name in session.views[view] if "." not in name]
            assert session.ask(f"select {', '.join(names)} from {view}").columns == tuple(names)


def test_a_run_without_rows_has_all_views(tmp_path: Path) -> None:
    """It was killed before its first turn: nobody's query fails for that."""
    from gamekeeper.runs.files.store import RunStore

    RunStore.create(tmp_path / "none", {"name": "demo"}).abandon()
    for view in ("agent_steps", "episodes", "returns", "endings", "orders", "labels", "agents"):
        assert rows(tmp_path / "none", f"select count(*) as n from {view}") == [{"n": 0}]


def test_runs_are_found_in_folders_patterns_and_parts(runs: Path, tmp_path: Path) -> None:
    """Each once, under the name by which it was reached; attempts without a receipt don't count."""
    for key, attempt in (("000000", "aa"), ("000000", "bb"), ("000001", "cc")):
        shutil.copytree(runs / "spread", tmp_path / "run" / "parts" / f"{key}.{attempt}")
    receipt = {"key": "000000", "folder": "parts/000000.bb"}
    (tmp_path / "run" / "parts" / "000000.json").write_text(json.dumps(receipt))
    count = "select run from runs order by run"
    parts = [{"run": f"{tmp_path.as_posix()}/run/parts/000000.bb"}]
    assert rows(tmp_path / "run", count) == parts
    assert rows(tmp_path / "run" / "parts", count) == parts
    assert len(rows(f"{runs}/*", runs, runs / "spread", count)) == 3
    assert len(rows(f"{runs}/*o*", count)) == 2
    assert rows(f"{tmp_path}/**/000000.bb", count) == parts


def test_patterns_follow_no_links(runs: Path, tmp_path: Path) -> None:
    """Links that lead back to their folder don't make a search endless."""
    shutil.copytree(runs / "spread", tmp_path / "spread")
    for name in ("one", "two", "three"):
        (tmp_path / "spread" / "frames" / name).mkdir(parents=True)
        (tmp_path / "spread" / "frames" / name / "back").symlink_to(tmp_path)
    count = "select count(*) as n from runs"
    assert rows(f"{tmp_path}/**/spread", count) == [{"n": 1}]


def test_names_with_patterns_in_them_are_names(runs: Path, tmp_path: Path) -> None:
    """A folder called like a pattern, or with quotes, is that folder and no other."""
    for name in ("a[b]", "it's", "x*y", "xzy", "q?", "a b"):
        shutil.copytree(runs / "two_robot_line", tmp_path / name)
    for name in ("a[b]", "it's", "x*y", "q?", "a b"):
        found = rows(tmp_path / name, "select distinct run from agent_steps")
        assert found == [{"run": (tmp_path / name).as_posix()}]


def test_names_stay_as_they_were_typed(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A relative folder stays relative."""
    monkeypatch.chdir(runs)
    assert rows("spread", "select distinct run from returns") == [{"run": "spread"}]


@pytest.mark.parametrize("name", ["nowhere", "", "*.none", "empty", "file"])
def test_what_holds_no_evidence_is_refused(name: str, tmp_path: Path) -> None:
    """The error says what was looked for."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(RunError, match="no run or evaluation was found"):
        query(tmp_path / "empty" if not name else tmp_path / name, "select 1 as one")


def test_checksums_are_compared_when_asked(runs: Path, tmp_path: Path) -> None:
    """Without that a changed file is read as it is."""
    shutil.copytree(runs / "spread", tmp_path / "run")
    timings = tmp_path / "run" / "timings.parquet"
    pq.write_table(pq.read_table(timings).slice(0, 1), timings)
    assert rows(tmp_path / "run", "select count(*) as n from timings") == [{"n": 1}]
    with pytest.raises(RunError, match="changed after it was finalized"):
        query(tmp_path / "run", "select 1 as one", check=True)


def test_a_damaged_file_is_named(runs: Path, tmp_path: Path) -> None:
    """With what is wrong with it, also where that is seen only while its rows are read."""
    shutil.copytree(runs / "spread", tmp_path / "run")
    (tmp_path / "run" / "agent_steps.parquet").write_bytes(b"PAR1")
    with pytest.raises(RunError, match=r"steps\.parquet can't be read"):
        query(tmp_path / "run", "select * from agent_steps")
    whole = bytearray((runs / "spread" / "agent_steps.parquet").read_bytes())
    whole[100:200] = bytes(100)
    (tmp_path / "run" / "agent_steps.parquet").write_bytes(whole)
    with pytest.raises(RunError, match=r"steps\.parquet can't be read"):
        query(tmp_path / "run", "select * from agent_steps")
    (tmp_path / "run" / "agent_steps.parquet").unlink()
    with pytest.raises(RunError, match="missing"):
        query(tmp_path / "run", "select * from agent_steps")


def test_evaluations_are_read_by_folder(tmp_path: Path) -> None:
    """Their raw episodes, beside runs or alone."""
    for name in ("one", "two"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "evaluation.json").write_text("{}")
        pq.write_table(
            pa.table({"policy": ["p", "q"], "return": [1.0, 2.0]}), folder / "episodes.parquet"
        )
    sql = 'select evaluation, avg("return") as mean from evaluations group by all order by 1'
    found = rows(tmp_path, sql)
    assert [(Path(row["evaluation"]).name, row["mean"]) for row in found] == [
        ("one", 1.5),
        ("two", 1.5),
    ]


@pytest.mark.parametrize(
    ("sql", "seen", "fix"),
    [
        ("selec 1", "syntax error", "views: "),
        ("select * from nowhere", "nowhere", "returns"),
        ("select retrun from returns", "retrun", "columns: returns (run, episode, agent, role"),
        ("select 'x'::int as n", "Could not convert", "views"),
    ],
)
def test_what_duckdb_cant_answer_is_said_with_a_fix(
    sql: str, seen: str, fix: str, runs: Path
) -> None:
    """Its own words, and what there is to ask for."""
    with pytest.raises(GamekeeperError, match="can't be answered") as caught:
        query(runs, sql)
    assert seen in caught.value.actual
    assert fix in caught.value.fix


def test_rows_are_handed_out_a_few_at_a_time(runs: Path) -> None:
    """One session answers one question after another; names that come twice stay apart."""
    with Session.of(runs) as session:
        asked = session.ask("select agent, agent from agents order by 1")
        assert asked.columns == ("agent", "agent_1")
        first, rest = asked.take(2), list(asked)
        assert (len(first), len(rest)) == (2, 5)
        pivot = session.ask("select * from (pivot orders on agent in ('picker') using count(*))")
        assert "picker" in pivot.columns
        assert "orders" in session.views


def test_rows_are_written_as_they_are(runs: Path, tmp_path: Path) -> None:
    """Parquet keeps the types, CSV the values; an earlier file is replaced, a run's never."""
    with Session.of(runs) as session:
        asked = session.ask("select run, episode, agent, obs from agent_steps")
        count = asked.write(tmp_path / "new" / "rows.parquet")
        table = pq.read_table(tmp_path / "new" / "rows.parquet")
        assert (table.num_rows, table.column_names) == (count, list(asked.columns))
        again = session.ask("select agent, length from returns order by 1 limit 1")
        assert again.write(tmp_path / "rows.csv") == 1
        assert (tmp_path / "rows.csv").read_text().splitlines() == ["agent,length", "agent_0,25"]
        session.ask("select 1 as one").write(tmp_path / "rows.csv")
        assert (tmp_path / "rows.csv").read_text().splitlines() == ["one", "1"]
        evidence = next(runs.rglob("agent_steps.parquet"))
        before = evidence.read_bytes()
        with pytest.raises(RunError, match="a file of a run"):
            session.ask("select 1 as one").write(evidence)
        assert evidence.read_bytes() == before
        with pytest.raises(GamekeeperError, match="known format"):
            session.ask("select 1 as one").write(tmp_path / "rows.xlsx")
