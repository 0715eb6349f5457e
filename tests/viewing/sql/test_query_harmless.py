"""A query can't reach anything but the runs that were named, and changes nothing."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from gamekeeper.errors import GamekeeperError

pytest.importorskip("duckdb")

from gamekeeper.viewing.sql import Session
from tests.viewing.sql.left_open import left_open

SECRET = "tell nobody"
mine = pa.table({"secret": [SECRET]})
"""A variable of this process, as a query may name it."""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run, another run and secrets beside it."""
    folder = tmp_path_factory.mktemp("home")
    gk.rollout("two_robot_line", episodes=2, out=folder / "run")
    shutil.copytree(folder / "run", folder / "other")
    (folder / "secret.csv").write_text(f"secret\n{SECRET}\n")
    (folder / "secret.json").write_text(f'{{"secret": "{SECRET}"}}')
    (folder / "run" / "note.csv").write_text(f"secret\n{SECRET}\n")
    pq.write_table(mine, folder / "secret.parquet")
    return folder


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    """Everything in a folder, with sizes and times."""
    found = {}
    for path in sorted(folder.rglob("*")):
        stat = path.stat()
        found[str(path.relative_to(folder))] = (stat.st_size, stat.st_mtime_ns)
    return found


READS = [
    "select * from read_csv('{home}/secret.csv')",
    "select * from read_csv_auto('{home}/secret.csv')",
    "select * from '{home}/secret.csv'",
    "select * from '{home}/secret.parquet'",
    "select * from read_parquet('{home}/secret.parquet')",
    "select * from read_parquet('{home}/other/agent_steps.parquet')",
    "select * from read_parquet('{home}/run/../other/agent_steps.parquet')",
    "select * from read_parquet('{home}/run/agent_steps.parquet/../../other/agent_steps.parquet')",
    "select * from read_parquet(['{home}/run/episodes.parquet', '{home}/other/episodes.parquet'])",
    "select * from read_parquet('{home}/*/agent_steps.parquet')",
    "select * from read_csv('{home}/run/note.csv')",
    "select * from read_json('{home}/secret.json')",
    "select * from read_ndjson_objects('{home}/secret.json')",
    "select * from read_text('{home}/secret.csv')",
    "select * from read_blob('{home}/secret.csv')",
    "select * from read_text('/etc/passwd')",
    "select * from sniff_csv('{home}/secret.csv')",
    "select * from parquet_schema('{home}/secret.parquet')",
    "select * from parquet_metadata('{home}/secret.parquet')",
    "select * from parquet_file_metadata('{home}/secret.parquet')",
    "select * from parquet_kv_metadata('{home}/secret.parquet')",
    "select * from glob('{home}/*')",
    "select * from glob('/etc/*')",
    "select * from read_parquet('http://127.0.0.1:9/x.parquet')",
    "select * from read_csv('s3://bucket/x.csv')",
    "select * from read_csv('/proc/self/environ')",
    "select * from read_text('/proc/self/environ')",
    "select * from query('select * from read_csv(''{home}/secret.csv'')')",
    "select * from query_table('{home}/secret.csv')",
    "with x as (select * from read_csv('{home}/secret.csv')) select * from x",
    "select (select secret from read_csv('{home}/secret.csv'))",
    "explain analyze select * from read_csv('{home}/secret.csv')",
    "summarize select * from '{home}/secret.csv'",
    "pivot '{home}/secret.csv' on secret using count(*)",
    "select getenv('HOME')",
    "select * from mine",
    "select * from pandas_scan(1)",
    "select * from arrow_scan(1, 2, 3)",
    "select * from python_arrow_scan(1)",
    "select * from json_execute_serialized_sql('{{}}')",
    "select * from query('select 1')",
]

CHANGES = [
    "copy (select 1) to '{home}/out.csv'",
    "copy agent_steps to '{home}/run/agent_steps.parquet'",
    "copy (select 1) to '{home}/run/agent_steps.parquet' (format parquet)",
    "copy agent_steps from '{home}/secret.csv'",
    "explain analyze copy (select 1) to '{home}/out.csv'",
    "explain analyze copy (select 1) to '{home}/run/agent_steps.parquet' (use_tmp_file false)",
    "explain copy (select 1) to '{home}/run/agent_steps.parquet'",
    "explain (format json) copy (select 1) to '{home}/run/agent_steps.parquet'",
    "with x as (copy (select 1 as x) to '{home}/run/agent_steps.parquet') select * from x",
    "with y as (with x as (copy (select 1) to '{home}/run/agent_steps.parquet') from x) from y",
    "select (with x as (copy (select 1) to '{home}/run/agent_steps.parquet') select 1)",
    "describe (with x as (copy (select 1) to '{home}/run/agent_steps.parquet') from x)",
    "explain analyze with x as (copy (select 1) to '{home}/run/agent_steps.parquet') from x",
    "select 1 union all (with x as (copy (select 1) to '{home}/run/agent_steps.parquet') from x)",
    "select * from query('with x as (copy (select 1) to ''{home}/run/episodes.parquet'') from x')",
    "copy (pivot orders on agent using count(*)) to '{home}/run/agent_steps.parquet'",
    "explain analyze copy (pivot orders on agent using count(*)) to '{home}/run/episodes.parquet'",
    "create table t as pivot orders on agent using count(*)",
    "create or replace view agent_steps as pivot orders on agent using count(*)",
    "pivot orders on agent using count(*)",
    "explain analyze drop view agent_steps",
    "explain analyze create table t as select 1",
    "explain analyze set threads = 1",
    "with x as (delete from labels returning *) select * from x",
    "with x as (insert into labels values (1) returning *) select * from x",
    "with x as (update labels set why = '' returning *) select * from x",
    "merge into labels using runs on false when not matched then insert values (1)",
    "describe delete from labels",
    "select * from enable_logging()",
    "select * from checkpoint()",
    "select setseed(0.5)",
    "select setval('x', 1), nextval('x')",
    "select write_log('x')",
    "export database '{home}/out'",
    "import database '{home}/out'",
    "attach '{home}/out.db' as out",
    "attach ':memory:' as other",
    "attach '{home}/run/agent_steps.parquet' as other",
    "install httpfs",
    "load httpfs",
    "load '{home}/x.duckdb_extension'",
    "create table t as select 1",
    "create view v as select 1",
    "create macro f(x) as x",
    "create secret s (type s3)",
    "create persistent secret s (type s3)",
    "drop view agent_steps",
    "delete from labels",
    "insert into labels values (1)",
    "update labels set why = ''",
    "set enable_external_access = true",
    "set lock_configuration = false",
    "set allowed_paths = ['/']",
    "set allowed_directories = ['/']",
    "set temp_directory = '{home}'",
    "set profiling_output = '{home}/out.json'",
    "set log_query_path = '{home}/out.log'",
    "set python_enable_replacements = true",
    "reset lock_configuration",
    "pragma enable_profiling",
    "pragma enable_external_access",
    "pragma database_list",
    "call enable_logging()",
    "checkpoint",
    "vacuum",
    "use memory",
    "begin",
    "prepare p as select 1",
    "execute p",
    "select 1; select 2",
    "select 1; copy (select 1) to '{home}/out.csv'",
    "select 1; set enable_external_access = true",
    "",
    "   ;  ",
    "-- nothing",
]


@pytest.fixture(scope="module")
def session(home: Path) -> Iterator[Session]:
    """A session over the run alone; all queries try it one after another."""
    with Session.of(home / "run") as opened:
        yield opened


@pytest.mark.parametrize("sql", READS + CHANGES)
def test_a_query_is_refused_that_leaves_the_runs(
    sql: str, home: Path, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever way out it tries: an error of the house, no secret in it, nothing on disk."""
    monkeypatch.setenv("GAMEKEEPER_TEST_SECRET", SECRET)
    monkeypatch.chdir(home)
    before = listing(home)
    count = session.ask("select count(*) from agent_steps").take(1)
    with pytest.raises(GamekeeperError) as caught:
        session.ask(sql.format(home=home.as_posix())).take(5)
    assert SECRET not in str(caught.value)
    assert session.ask("select count(*) from agent_steps").take(1) == count
    assert listing(home) == before


ASKED = [
    "select 1 as a, 1.5::decimal(4, 2) as b, [1, 2]::int[] as c, {'x': 1} as d",
    "from agent_steps",
    "table agent_steps",
    "values (1), (2)",
    "with x as (from agents), y as materialized (select agent from x) select distinct * from y",
    "with recursive t(n) as (select 1 union all select n + 1 from t where n < 3) from t",
    "select sum(reward) filter (where turn > 0) from agent_steps group by cube(agent) having true",
    "select * from returns a join returns b using (run, episode) where a.agent < b.agent",
    "select * from agent_steps asof join orders o on agent_steps.turn >= o.turn limit 1",
    "select agent from agent_steps semi join agents using (agent) order by agent desc limit 10%",
    "select distinct on (agent) agent, lag(turn) over (order by turn) from agent_steps",
    "select (select max(turns) from episodes), turn in (select turn from orders) from agent_steps",
    "select agent from agent_steps union by name select agent from agents except all select 'x'",
    "select * exclude (run) replace (turn + 1 as turn), columns('tu.*') from agent_steps",
    "select list_transform([1, 2], lambda x: x + 1), [x for x in [1] if x > 0]",
    "select json_extract_string(policies, '$.picker.version') from episodes",
    "select * from json_each((select any_value(policies) from episodes))",
    "select unnest([1, 2]), random() > 0, uuid() is not null",
    "select * from range(3), generate_series(1, 2), lateral (select 1)",
    "select * from query_table('agent_' || 'steps')",
    "pivot orders on agent in ('picker', 'carrier') using count(*)",
    "from orders pivot (count(*) for agent in ('picker'))",
    "unpivot (select 1 as a, 2 as b) on a, b",
    "describe agent_steps",
    "describe select 1",
    "show tables",
    "summarize agent_steps",
    "summarize select 1",
    "select * from (describe agent_steps)",
    "explain select 1",
    "explain analyze select agent, count(*) from agent_steps group by all",
    "EXPLAIN ANALYZE (select 1) union all select 2",
    "explain with x as (select 1) from x",
    "select * from duckdb_settings()",
    "select current_setting('threads'), now() > '2020-01-01', version()",
    "select 1 -- and a comment ; copy (select 1) to 'x'",
    "select 'copy (select 1) to ''x''; drop view agent_steps' as text, \"order\" from agent_steps",
]


@pytest.mark.parametrize("sql", ASKED)
def test_a_query_that_reads_is_answered(sql: str, session: Session) -> None:
    """Whatever SQL has for reading goes through."""
    assert session.ask(sql).take(1)


WRITTEN = ["agent_steps.parquet", "episodes.parquet", "manifest.json", "new.parquet"]


@pytest.mark.parametrize("file", WRITTEN)
def test_duckdb_itself_can_write_nothing_into_a_run(
    file: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a statement isn't judged first: no path of the run is open to DuckDB."""
    monkeypatch.chdir(home)
    before = listing(home)
    with Session.of(home / "run") as session:
        session.ask("select * from agent_steps join episodes using (episode)").take(1)
        for path in (f"{home}/run/{file}", f"run/{file}", f"./run/../run/{file}"):
            for sql in (
                f"copy (select 1 as x) to '{path}' (format parquet, use_tmp_file false)",
                f"explain analyze copy (select 1 as x) to '{path}' (format csv)",
                f"with x as (copy (select 1 as x) to '{path}') select * from x",
                f"attach '{path}' as other",
                f"select * from read_blob('{path}')",
            ):
                with pytest.raises(session._duckdb.Error):
                    session._connection.execute(sql).fetchall()
    assert listing(home) == before


def test_a_session_holds_nothing_that_could_be_changed(home: Path) -> None:
    """All that it shows are views: no table is there whose rows a statement could take away."""
    with Session.of(home / "run") as session:
        assert {"runs", "agents", "labels", "agent_steps"} <= set(session.views)
        found = session._connection.execute("select * from duckdb_tables()").fetchall()
        assert found == []


def test_a_query_needs_few_open_files(home: Path, tmp_path: Path) -> None:
    """A query over many runs has the file open that it reads, not all of them."""
    for number in range(40):
        shutil.copytree(home / "run", tmp_path / f"run-{number}")
    program = (
        "import resource, sys; from gamekeeper.viewing.sql import Session; "
        "import duckdb; resource.setrlimit(resource.RLIMIT_NOFILE, (32, 32)); "
        f"s = Session.of({str(tmp_path)!r}); "
        "print(s.ask('select count(distinct run) from agent_steps join episodes "
        "using (run, episode)').take(1)); s.close()"
    )
    pytest.importorskip("resource", reason="only Unix bounds the number of open files")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("[(40,)]\n", 0), done.stderr


def test_settings_stay_locked_when_a_query_tries_functions(home: Path) -> None:
    """What the session allows is told, and the same after a query as before."""
    off = (
        "enable_external_access",
        "autoinstall_known_extensions",
        "autoload_known_extensions",
        "python_enable_replacements",
        "allow_persistent_secrets",
    )
    with Session.of(home / "run") as session:
        for name in off:
            assert session.ask(f"select current_setting('{name}')").take(1) == [(False,)]
        assert session.ask("select current_setting('lock_configuration')").take(1) == [(True,)]
        assert session.ask("select * from duckdb_secrets()").take(1) == []


def test_a_link_out_of_the_run_is_not_followed(home: Path, tmp_path: Path) -> None:
    """A run from elsewhere whose table is a link to another file is refused."""
    shutil.copytree(home / "run", tmp_path / "run")
    (tmp_path / "run" / "agent_steps.parquet").unlink()
    (tmp_path / "run" / "agent_steps.parquet").symlink_to(home / "secret.parquet")
    with pytest.raises(GamekeeperError, match="is a link"):
        Session.of(tmp_path / "run")


def test_a_file_that_no_checksums_names_is_not_read(home: Path, tmp_path: Path) -> None:
    """States that somebody put beside a finalized run aren't evidence."""
    shutil.copytree(home / "run", tmp_path / "run")
    finalized = {path.name for path in (tmp_path / "run").iterdir()}
    if "states.parquet" not in finalized:
        shutil.copy(home / "secret.parquet", tmp_path / "run" / "states.parquet")
    with Session.of(tmp_path / "run") as session:
        assert ("states" in session.views) == ("states.parquet" in finalized)


def test_what_spills_goes_to_a_folder_that_is_taken_away(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not into the folder in which somebody happens to work, and nothing of it is left."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    with Session.of(home / "run") as session:
        where = session.ask("select current_setting('temp_directory')").take(1)[0][0]
        assert Path(where).is_relative_to(tmp_path / "temporary")
    assert os.listdir(tmp_path) == ["temporary"]  # noqa: PTH208  # names alone
    assert list((tmp_path / "temporary").iterdir()) == []


def test_hostile_names_stay_names(home: Path, tmp_path: Path) -> None:
    """A folder called like SQL is a value in the column `run`, in finalized and in open runs."""
    name = "x') ; copy (select 1) to 'out.csv' --"
    shutil.copytree(home / "run", tmp_path / name)
    left_open(home / "run", tmp_path / f"{name}2")
    with Session.of(tmp_path) as session:
        found = {row[0] for row in session.ask("select distinct run from agent_steps")}
    assert {Path(run).name for run in found} == {name, f"{name}2"}


def test_duckdb_is_named_where_it_is_missing(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The extra that brings it is the fix."""
    monkeypatch.setitem(sys.modules, "duckdb", None)
    with pytest.raises(GamekeeperError, match="isn't installed") as caught:
        Session.of(home / "run")
    assert caught.value.fix == "pip install 'gamekeeper[query]'"
