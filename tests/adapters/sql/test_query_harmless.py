"""A query can't reach anything but the bundles that were named, and changes nothing."""

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gamekeeper as gk
from gamekeeper.errors import GamekeeperError

pytest.importorskip("duckdb")

from gamekeeper.adapters.sql import Session
from tests.adapters.sql.left_open import left_open

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
    "select * from read_parquet('{home}/other/steps.parquet')",
    "select * from read_parquet('{home}/run/../other/steps.parquet')",
    "select * from read_parquet('{home}/run/steps.parquet/../../other/steps.parquet')",
    "select * from read_parquet(['{home}/run/steps.parquet', '{home}/other/steps.parquet'])",
    "select * from read_parquet('{home}/*/steps.parquet')",
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
]  # fmt: skip

CHANGES = [
    "copy (select 1) to '{home}/out.csv'",
    "copy steps to '{home}/run/steps.parquet'",
    "copy (select 1) to '{home}/run/steps.parquet' (format parquet)",
    "copy steps from '{home}/secret.csv'",
    "explain analyze copy (select 1) to '{home}/out.csv'",
    "export database '{home}/out'",
    "import database '{home}/out'",
    "attach '{home}/out.db' as out",
    "attach ':memory:' as other",
    "attach '{home}/run/steps.parquet' as other",
    "install httpfs",
    "load httpfs",
    "load '{home}/x.duckdb_extension'",
    "create table t as select 1",
    "create view v as select 1",
    "create macro f(x) as x",
    "create secret s (type s3)",
    "create persistent secret s (type s3)",
    "drop view steps",
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
]  # fmt: skip


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
    count = session.ask("select count(*) from steps").take(1)
    with pytest.raises(GamekeeperError) as caught:
        session.ask(sql.format(home=home.as_posix())).take(5)
    assert SECRET not in str(caught.value)
    assert session.ask("select count(*) from steps").take(1) == count
    assert listing(home) == before


def test_settings_stay_locked_when_a_query_tries_functions(home: Path) -> None:
    """What the session allows is told, and the same after a query as before."""
    off = (
        "enable_external_access", "autoinstall_known_extensions", "autoload_known_extensions",
        "python_enable_replacements", "allow_persistent_secrets",
    )  # fmt: skip
    with Session.of(home / "run") as session:
        for name in off:
            assert session.ask(f"select current_setting('{name}')").take(1) == [(False,)]
        assert session.ask("select current_setting('lock_configuration')").take(1) == [(True,)]
        assert session.ask("select * from duckdb_secrets()").take(1) == []


def test_a_link_out_of_the_run_is_not_followed(home: Path, tmp_path: Path) -> None:
    """A bundle from elsewhere whose table is a link to another file is refused."""
    shutil.copytree(home / "run", tmp_path / "run")
    (tmp_path / "run" / "steps.parquet").unlink()
    (tmp_path / "run" / "steps.parquet").symlink_to(home / "secret.parquet")
    with pytest.raises(GamekeeperError, match="is a link"):
        Session.of(tmp_path / "run")


def test_a_file_that_no_seal_names_is_not_read(home: Path, tmp_path: Path) -> None:
    """States that somebody put beside a sealed run aren't evidence."""
    shutil.copytree(home / "run", tmp_path / "run")
    sealed = {path.name for path in (tmp_path / "run").iterdir()}
    if "states.parquet" not in sealed:
        shutil.copy(home / "secret.parquet", tmp_path / "run" / "states.parquet")
    with Session.of(tmp_path / "run") as session:
        assert ("states" in session.views) == ("states.parquet" in sealed)


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
    """A folder called like SQL is a value in the column `run`, in sealed and in open runs."""
    name = "x') ; copy (select 1) to 'out.csv' --"
    shutil.copytree(home / "run", tmp_path / name)
    left_open(home / "run", tmp_path / f"{name}2")
    with Session.of(tmp_path) as session:
        found = {row[0] for row in session.ask("select distinct run from steps")}
    assert {Path(run).name for run in found} == {name, f"{name}2"}


def test_duckdb_is_named_where_it_is_missing(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The extra that brings it is the mend."""
    monkeypatch.setitem(sys.modules, "duckdb", None)
    with pytest.raises(GamekeeperError, match="isn't installed") as caught:
        Session.of(home / "run")
    assert caught.value.mend == "pip install 'gamekeeper[query]'"
