"""`gamekeeper query RUN... SQL`, and the how-to pages around it."""

import csv
import io
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from tests.cli.lines import document, said
from tests.surface.sources import ROOT

pytest.importorskip("duckdb")

from gamekeeper.viewing.sql import Session
from tests.surface.typed_pages import blocks_of, run_block

MEANS = "select agent, avg(return) as mean from returns group by agent order by agent"


def test_query_shows_a_table(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A heading, a row for each agent, numbers at the right; nothing on stderr."""
    code, out, err = said(capfd, "query", line_run, MEANS)
    assert (code, err) == (0, "")
    lines = [line.split() for line in out.splitlines()]
    means = {name: each.return_mean for name, each in gk.load(line_run).summary.agents.items()}
    assert lines[0] == ["agent", "mean"]
    assert {name: float(mean) for name, mean in lines[1:]} == pytest.approx(means, rel=1e-5)


def test_query_shows_wide_rows_as_blocks(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """No line is wider than 80 columns, whatever is asked; what isn't shown is said."""
    code, out, err = said(capfd, "query", line_run, "select * from agent_steps", "--rows", 2)
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    assert out.splitlines()[0] == "row 1"
    assert out.rstrip().endswith("...")
    assert "the first 2 rows" in err
    for sql in ("select * from episodes", "select fingerprint, policies, run from episodes"):
        assert max(map(len, said(capfd, "query", line_run, sql)[1].splitlines())) <= 80


def test_query_prints_one_document(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Columns with types, all rows as objects; what JSON lacks has a text or null."""
    sql = (
        "select agent, 'NaN'::double as uneven, 'ab'::blob as bytes, [1, 2] as list, "
        "date '2026-01-02' as day, 1.50::decimal(4, 2) as price, agent from agents order by 1"
    )
    code, found = document(capfd, "query", line_run, sql)
    assert (code, found["runs"]) == (0, 1)
    assert [each["type"] for each in found["columns"]][:3] == ["VARCHAR", "DOUBLE", "BLOB"]
    assert found["rows"][0] == {
        "agent": "carrier",
        "uneven": None,
        "bytes": "6162",
        "list": [1, 2],
        "day": "2026-01-02",
        "price": "1.50",
        "agent_1": "carrier",
    }


def test_query_writes_files(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """All rows, whatever --rows says; the document names the file."""
    out = tmp_path / "new" / "rows.parquet"
    code, found = document(capfd, "query", line_run, "from agent_steps", "--out", out, "--rows", 1)
    count = gk.load(line_run).agent_steps.num_rows
    assert (code, found) == (0, {"runs": 1, "path": str(out), "rows_written": count})
    assert pq.read_table(out).num_rows == count
    code, text, err = said(capfd, "query", line_run, MEANS, "--out", tmp_path / "rows.csv")
    assert (code, text, err) == (0, f"Written  {tmp_path / 'rows.csv'}: 2 rows\n", "")
    with (tmp_path / "rows.csv").open() as file:
        assert [row[0] for row in csv.reader(file)] == ["agent", "carrier", "picker"]
    assert said(capfd, "query", line_run, MEANS, "--out", tmp_path / "rows.csv")[0] == 0


def test_query_lists_the_views(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Without a query; names that stand for the same are listed once."""
    code, found = document(capfd, "query", line_run)
    assert code == 0
    assert {"returns", "endings", "orders", "labels", "agent_steps"} <= found["views"].keys()
    assert "order" not in found["views"]
    assert "returns\n  run VARCHAR, episode INTEGER" in said(capfd, "query", line_run)[1]


def test_query_is_read_from_stdin(
    line_run: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dash stands for it."""
    monkeypatch.setattr("sys.stdin", io.StringIO(MEANS))
    code, found = document(capfd, "query", line_run, "-")
    assert (code, len(found["rows"])) == (0, 2)


def test_query_obeys_no_control_character(
    line_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """What a terminal would obey is shown as text."""
    sql = "select chr(27) || '[2J' || chr(10) || 'x' as a, 1 as \"b\x1b[0m\" from agents limit 1"
    out = said(capfd, "query", line_run, sql)[1]
    assert "\x1b" not in out
    assert "\\u001b[2J x" in out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nowhere", "select 1 as one"], "no run or evaluation was found"),
        (["select 1 as one"], "the name of a run is missing"),
        (["select 1 as one", "RUN"], "the query stands before a run"),
        (["RUN", "select nothing from returns"], "columns: returns (run, episode, agent"),
        (["RUN", "copy (select 1) to 'x.csv'"], "one statement that reads"),
        (["RUN", "select * from read_csv('/etc/passwd')"], "the runs that the command names"),
        (["RUN", "select 1 as a; select 2 as b"], "SELECT and SELECT"),
        (["RUN", "select 1 as one", "--out", "x.xlsx"], ".parquet or .csv"),
        (["RUN", "select 1 as one", "--rows", "0"], "greater than or equal to 1"),
    ],
)
def test_query_refuses_what_makes_no_sense(
    words: list[str],
    told: str,
    line_run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2, the reason on stderr, nothing on stdout or on disk."""
    monkeypatch.chdir(tmp_path)
    line = [str(line_run) if word == "RUN" else word for word in words]
    code, out, err = said(capfd, "query", *line)
    assert (code, out) == (2, "")
    assert told in err
    assert list(tmp_path.iterdir()) == []


def test_query_ends_at_ctrl_c(
    line_run: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 130, however DuckDB tells that it was interrupted."""

    class Interrupted:
        columns, types = ("one",), ("INTEGER",)

        def take(self, most: int) -> None:
            with self.session._answering("select 1 as one"):
                raise RuntimeError("Query interrupted")

        def __init__(self, session: Session) -> None:
            self.session = session

    monkeypatch.setattr(Session, "ask", lambda session, sql: Interrupted(session))
    code, out, err = said(capfd, "query", line_run, "select 1 as one")
    assert (code, out) == (130, "")
    assert err == "interrupted\n"


def test_query_says_errors_as_documents(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """One JSON document also then."""
    code, out, _ = said(capfd, "query", line_run, "selec 1", "--json")
    assert code == 2
    assert json.loads(out)["error"]["what"] == "the query can't be answered"


@pytest.mark.parametrize("name", ["query", "stale-evidence", "video"])
def test_how_to_pages_work_as_they_are_typed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Every line on the page, one after another, exits as it says."""
    if name == "video":
        pytest.importorskip("imageio_ffmpeg")
    monkeypatch.chdir(tmp_path)
    gk.rollout("two_robot_line", episodes=2, out="runs/demo")
    known: dict[str, object] = {"__name__": "docs"}
    for block in blocks_of(ROOT / "docs" / "how-to" / f"{name}.md"):
        if block.kind in ("sh", "python"):
            run_block(block, known)
