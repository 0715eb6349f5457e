"""What an audit says of foreign environments: each row of the table of audits in docs/zoo.md.

Prints a JSON line for each environment: package, version, API, steps, seconds, how many checks came
to which outcome, and each broken promise with what its program said when it was run in a process of
its own: `confirmed` where it raised, as it must as long as the fault is there. A row whose package
isn't installed says so; packages that can't live together have lists in requirements/zoo/.

    python benchmarks/zoo_audit.py [--quick] [--only WORD ...] [--env SPEC ...] [--out FOLDER]
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from typing import Any, Final

from gamekeeper.auditing.audit_process import audit
from gamekeeper.auditing.result import AuditResult
from gamekeeper.errors import GamekeeperError

OURS: Final = ("warehouse", "warehouse_turns", "handover", "two_robot_line")
MPE: Final = (
    "collect_treasure_v1",
    "simple_adversary_v3",
    "simple_crypto_v3",
    "simple_formation_v1",
    "simple_line_v1",
    "simple_push_v3",
    "simple_reference_v3",
    "simple_speaker_listener_v4",
    "simple_spread_v3",
    "simple_tag_v3",
    "simple_v3",
    "simple_world_comm_v3",
)
BOTH: Final = (
    "butterfly/cooperative_pong-v6",
    "butterfly/knights_archers_zombies-v11",
    "butterfly/pistonball-v6",
    "sisl/multiwalker-v9",
    "sisl/pursuit-v5",
)
TURNS: Final = (
    "chess-v6",
    "connect_four-v3",
    "go-v5",
    "hanabi-v5",
    "leduc_holdem-v4",
    "rps-v2",
    "texas_holdem-v4",
    "texas_holdem_no_limit-v6",
    "tictactoe-v3",
)
SNIPPET_S: Final = 300.0
"""A program that takes longer shows nothing."""
OURSELVES: Final = ("SyntaxError", "NameError", "ModuleNotFoundError")
"""What a program of ours ends with where the fault is the program's."""


@dataclass(frozen=True, slots=True)
class Row:
    """One environment of the zoo."""

    module: str
    """What has to be importable."""
    spec: str
    kwargs: Mapping[str, Any] = field(default_factory=dict)


def rows() -> Iterator[Row]:
    """Ours first, then what the first list installs, then the rows of the replays."""
    for spec in OURS:
        yield Row("gamekeeper", spec)
    for name in MPE:
        for factory in ("parallel_env", "env"):
            yield Row("mpe2", f"mpe2.{name}:{factory}")
    for name in BOTH:
        yield from (Row("pettingzoo", name), Row("pettingzoo", f"aec:{name}"))
    for name in TURNS:
        yield Row("pettingzoo", f"classic/{name}")
    import zoo  # beside this file

    for row in zoo.ROWS:
        yield Row(row.module, row.spec, row.kwargs)


def main() -> int:
    """Audits what is installed; 1 where an audit failed, or a finding isn't confirmed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="3,000 steps in place of 20,000")
    parser.add_argument("--only", nargs="*", default=[], help="words, one of which a row must hold")
    parser.add_argument("--env", nargs="*", default=[], help="these in place of the table")
    parser.add_argument("--out", type=Path, help="a folder for audits and programs")
    asked = parser.parse_args()
    table = _named(asked.env) or list(rows())
    failed = False
    for row in table:
        if asked.only and not any(word in row.spec for word in asked.only):
            continue
        line = audited(row, quick=asked.quick, out=asked.out)
        bad = [each for each in line.get("failed", ()) if each["program"] != "confirmed"]
        failed = failed or bool(bad) or bool(line.get("errors")) or "failed" in line
        print(json.dumps(line), flush=True)
    return int(failed)


def _named(specs: list[str]) -> list[Row]:
    """The rows of these names; what isn't in the table is taken as it is."""
    known = {row.spec: row for row in rows()}
    return [known.get(spec, Row(spec.partition(".")[0], spec)) for spec in specs]


def audited(row: Row, *, quick: bool, out: Path | None) -> dict[str, Any]:
    """One row, audited where its package is there."""
    line: dict[str, Any] = {"env": row.spec, "kwargs": dict(row.kwargs)}
    if row.module.isidentifier() and importlib.util.find_spec(row.module) is None:
        return {**line, "missing": row.module}
    line |= _package(row)
    begun_s = time.monotonic()
    try:
        found = audit(row.spec, quick=quick, env_kwargs=row.kwargs)
    except GamekeeperError as error:
        return {**line, "failed": str(error)}
    line |= {
        "api": found.api,
        "steps": found.steps,
        "seconds": round(time.monotonic() - begun_s, 1),
        "slowest": max(found.timings, key=lambda name: found.timings[name]),
        **found.counts,
        "failed": [_confirmed(found, place, out) for place in range(len(found.failed))],
        "errors": [each.id for each in found.verdicts if each.outcome == "error"],
    }
    if out is not None:
        _write(out / _slug(found.environment) / "audit.json", json.dumps(found.to_json(), indent=1))
    return line


def _confirmed(found: AuditResult, place: int, out: Path | None) -> dict[str, Any]:
    """One broken promise, with what became of the program of each finding."""
    verdict = found.failed[place]
    said = []
    for number, finding in enumerate(verdict.findings):
        if out is not None:
            name = f"{verdict.id}{f'-{number}' if number else ''}.py"
            _write(out / _slug(found.environment) / name, finding.reproduce)
        said.append(_ran(finding.reproduce))
    first = verdict.findings[0] if verdict.findings else None
    return {
        "id": verdict.id,
        "severity": verdict.severity,
        "where": first and first.where,
        "expected": first and first.expected,
        "seen": first and first.seen,
        "program": next((each for each in said if each != "confirmed"), "confirmed"),
    }


def _ran(program: str) -> str:
    """`confirmed`, or what the program did in place of raising."""
    with tempfile.TemporaryDirectory(prefix="zoo-") as folder:
        path = Path(folder, "program.py")
        path.write_text(program)
        command = [sys.executable, str(path)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=SNIPPET_S)
        except subprocess.TimeoutExpired:
            return f"took more than {SNIPPET_S:.0f} s"
    last = (done.stderr.strip().splitlines() or [""])[-1]
    if done.returncode == 1 and not last.startswith(OURSELVES):
        return "confirmed"
    return f"ended with {done.returncode}: {last[:200]}"


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def _slug(spec: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in spec)


def _package(row: Row) -> dict[str, str]:
    for name in packages_distributions().get(row.module, [row.module]):
        try:
            return {"package": name, "version": version(name)}
        except PackageNotFoundError:
            continue
    return {"package": row.module, "version": ""}


if __name__ == "__main__":
    sys.exit(main())
