"""Attacks on evidence: SQL that writes, code beside a run, hashes made to fit, annotations."""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.attacking.attack import MARK, Attack, Found
from benchmarks.fuzzing.run_folders import finalize_again

WRITES: Final = (
    "explain analyze copy (select 1 as x) to 'line/agent_steps.parquet' "
    "(format parquet, use_tmp_file false)",
    "copy (select 1 as x) to 'line/agent_steps.parquet' (format parquet, use_tmp_file false)",
    "with x as (copy (select 1) to 'line/agent_steps.parquet') select * from x",
    "copy (pivot agent_steps on agent using sum(reward)) "
    "to 'line/agent_steps.parquet' (format parquet)",
    "explain analyze copy (pivot agent_steps on agent using sum(reward)) "
    "to 'line/agent_steps.parquet'",
    "select 1; copy (select 1) to 'line/manifest.json'",
    "copy agent_steps to 'line/new.csv'",
    "copy agent_steps to 'out' (format parquet, partition_by (agent))",
    "export database 'line'",
    "attach 'line/x.db' as x",
    "explain analyze drop view agent_steps",
    "drop view agent_steps",
    "create table t as pivot agent_steps on agent using sum(reward)",
    "create or replace view agent_steps as select 1",
    "with x as (delete from agent_steps returning *) select * from x",
    "insert into agent_steps select * from agent_steps",
    "prepare x as copy (select 1) to 'line/agent_steps.parquet'",
    "set allowed_directories = ['/']",
    "pragma enable_external_access",
    "load httpfs",
    "install httpfs",
    "call dbgen(sf=0.01)",
    "select * from read_text('/etc/passwd')",
    "select * from read_blob('line/manifest.json')",
    "select getenv('HOME') as home",
    "select * from query('copy (select 1) to ''line/agent_steps.parquet''')",
    "checkpoint",
    "vacuum",
)
READS: Final = (
    "select agent, sum(reward) from agent_steps group by agent",
    "explain select * from agent_steps",
    "explain analyze select count(*) from agent_steps",
    "with x as (select * from agent_steps) select count(*) from x",
)


def queries() -> list[Attack]:
    """SQL that writes or reaches elsewhere is refused; pure reads are answered."""
    refused = [
        Attack(f"query: {sql[:60]}", ("query", "line", sql), codes=frozenset({2})) for sql in WRITES
    ]
    return refused + [
        Attack(f"query: {sql}", ("query", "line", sql), codes=frozenset({0})) for sql in READS
    ]


OPTIONAL: Final = ("scipy", "pygame", "chess", "cv2", "torch", "conftest", "farm_extra")
"""Modules that are imported where they are found, if at all."""
MODULES: Final = (
    *OPTIONAL,
    "pandas",
    "numpy",
    "numba",
    "pyarrow",
    "duckdb",
    "gymnasium",
    "pettingzoo",
    "sitecustomize",
    "usercustomize",
    "two_robot_line",
    "gamekeeper",
    "typing_extensions",
)
"""Those and the ones that every command imports, which only its own packages may provide."""
COMMANDS: Final = {
    "replay": ("replay", "."),
    "diagnose": ("diagnose", ".", "--episodes", "100"),
    "verify": ("verify", "."),
    "report": ("report", ".", "--out", "../report.html"),
}
OUTPUTS: Final = ("report.html", "line-diagnosis", "line/annotations.jsonl")
"""What they write."""


def consent() -> list[Attack]:
    """Modules beside evidence are never imported, wherever the command is typed."""
    attacks = [
        Attack(
            f"consent: {name} in the run's folder",
            words,
            cwd="line",
            out=OUTPUTS,
            prepare=partial(_plant, "line", MODULES),
        )
        for name, words in COMMANDS.items()
    ]
    attacks += [
        Attack(
            f"consent: {name} in the run's folder, which is on the path",
            words,
            flags=(),
            prepare=partial(_plant, "line", OPTIONAL),
            cwd="line",
            out=OUTPUTS,
        )
        for name, words in COMMANDS.items()
    ]
    for path in ("", ".", "line", ":", "./line"):
        attacks.append(
            Attack(
                f"consent: replay with PYTHONPATH={path!r}",
                ("replay", "line"),
                prepare=_plant_both,
                variables={"PYTHONPATH": path},
            )
        )
    attacks.append(
        Attack(
            "consent: replay of a run that names a file",
            ("replay", "line"),
            codes=frozenset({2}),
            prepare=_name_a_file,
        )
    )
    attacks.append(
        Attack(
            "consent: an installed plug-in that imports what isn't installed",
            ("replay", "."),
            prepare=_plug_in,
            cwd="line",
            variables={"PYTHONPATH": "../site"},
        )
    )
    return attacks


def _plant(place: str, names: Sequence[str], work: Path) -> None:
    """Modules that say that they ran, under names that are likely to be imported."""
    text = f"open({str(work.parent / MARK)!r}, 'a').write(__name__)\nraise ImportError(__name__)\n"
    for name in names:
        (work / place / f"{name}.py").write_text(text, encoding="utf-8")
    (work / place / "evil.pth").write_text(f"import scipy; {text.splitlines()[0]}\n")


def _plant_both(work: Path) -> None:
    _plant("line", OPTIONAL, work)
    _plant(".", OPTIONAL, work)


def _name_a_file(work: Path) -> None:
    _plant("line", OPTIONAL, work)
    path = work / "line" / "manifest.json"
    manifest = json.loads(path.read_bytes())
    file = {"kind": "file", "entry_point": f"{work / 'line' / 'scipy.py'}:make"}
    manifest["environment"] |= file
    path.write_text(json.dumps(manifest), encoding="utf-8")
    finalize_again(work / "line", "manifest.json")


def _plug_in(work: Path) -> None:
    """An opener of an installed package, which imports an optional one where that is found."""
    _plant("line", OPTIONAL, work)
    info = work / "site" / "farm-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: farm\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[gamekeeper.openers]\nfarm = farm_opener\n")
    text = "try:\n    import farm_extra\nexcept ImportError:\n    pass\n\n\ndef opens(spec): ...\n"
    (work / "site" / "farm_opener.py").write_text(text)


def forged() -> list[Attack]:
    """Evidence that was changed, its hashes made to fit, isn't what its root digest says."""
    changes: dict[str, Callable[[Path], None]] = {
        "an info": partial(_column, "agent_steps", "info", '{"forged":1}'),
        "a reward": partial(_column, "agent_steps", "reward", 1e6),
        "policies": partial(_column, "episodes", "policies", "{}"),
        "turns": partial(_column, "episodes", "turns", 1),
        "an end": partial(_column, "episodes", "end", "failed"),
        "timings": partial(_column, "timings", None, 1),
        "an extra column": _extra_column,
        "a status": partial(_entry, "status", "failed"),
        "versions": partial(_entry, "versions", {"numpy": "0"}),
        "a contract": partial(_entry, "contract", {"name": "forged"}),
        "a level": partial(_entry, "level", "digest"),
    }
    attacks = [
        Attack(f"forged: {name}", act=partial(_forge, change), codes=frozenset({1, 2}))
        for name, change in changes.items()
    ]
    attacks = [_allowing_line(attack) for attack in attacks]
    attacks.append(
        _allowing_line(
            Attack("forged: nothing", act=partial(_forge, _unchanged), codes=frozenset({0}))
        )
    )
    stray = Attack(
        "forged: a stray file is listed",
        ("verify", "line"),
        prepare=_stray,
        more=lambda _, found: {"listed": "stray.bin" in found.said},
    )
    return [*attacks, stray]


LAST: Final = ("the last line is removed", "all are removed")
"""Changes of annotations that leave a run as it once was."""


def notes() -> list[Attack]:
    """Annotations that were changed or whose beginning is gone are found; added last, removed last.

    They aren't evidence: the root digest leaves them out, so that a label doesn't change it.
    """
    ways: dict[str, Callable[[list[str]], list[str]]] = {
        "the last line is changed": lambda lines: [*lines[:-1], lines[-1].replace("sec", "thi")],
        "the last line is removed": lambda lines: lines[:-1],
        "the first line is removed": lambda lines: lines[1:],
        "the order is changed": lambda lines: lines[::-1],
        "all are removed": lambda lines: [],
    }
    return [
        _allowing_line(
            Attack(
                f"notes: {name}",
                act=partial(_forge, partial(_rewrite, way)),
                codes=frozenset({0}) if name in LAST else frozenset({1, 2}),
            )
        )
        for name, way in ways.items()
    ]


def _allowing_line(attack: Attack) -> Attack:
    return replace(attack, out=("line",))


def _forge(change: Callable[[Path], None], work: Path) -> Found:
    """Notes the root digest, changes the run, and verifies it against that digest."""
    said = _gamekeeper(work, "verify", "line", "--json")
    root = json.loads(said.stdout).get("root")
    if not root:
        return Found(-1, "verify --json names no root digest")
    change(work / "line")
    done = _gamekeeper(work, "verify", "line", "--root", str(root))
    return Found(done.returncode, done.stdout + done.stderr)


def _gamekeeper(work: Path, *words: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-P", "-m", "gamekeeper", *words]
    return subprocess.run(line, cwd=work, capture_output=True, text=True, check=False)


def _column(table: str, name: str | None, value: Any, run: Path) -> None:
    """One value of a column is another one now; without a name, of the first column of numbers."""
    path = run / f"{table}.parquet"
    rows = pq.read_table(path)
    name = name or next(f.name for f in reversed(rows.schema) if pa.types.is_integer(f.type))
    at = rows.schema.get_field_index(name)
    values = [value, *rows.column(at).to_pylist()[1:]]
    forged = pa.array(values, rows.schema.field(at).type)
    _write(run, table, rows.set_column(at, rows.schema.field(at), forged))


def _extra_column(run: Path) -> None:
    rows = pq.read_table(run / "agent_steps.parquet")
    _write(run, "agent_steps", rows.append_column("note", pa.array(["forged"] * rows.num_rows)))


def _write(run: Path, table: str, rows: pa.Table) -> None:
    pq.write_table(rows, run / f"{table}.parquet")
    finalize_again(run, f"{table}.parquet")


def _entry(name: str, value: Any, run: Path) -> None:
    path = run / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_bytes()), name: value}), encoding="utf-8")
    finalize_again(run, "manifest.json")


def _unchanged(run: Path) -> None:
    del run


def _stray(work: Path) -> None:
    (work / "line" / "stray.bin").write_bytes(b"stray")


def _rewrite(way: Callable[[list[str]], list[str]], run: Path) -> None:
    path = run / "annotations.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(way(lines)), encoding="utf-8")


KINDS: Final = {"query": queries, "consent": consent, "forged": forged, "notes": notes}
