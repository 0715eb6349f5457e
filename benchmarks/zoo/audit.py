"""Audits of the catalogue's public environments, one after another, each in its own environment.

Keeps each audit's JSON in a folder and goes on where it was stopped: what has a result isn't
audited again. Virtual environments lie in one folder, named as the lists in requirements/zoo/ that
they are made from; public repositories lie in the folder ZOO_REPOSITORIES as `owner+name`, at the
commit of the catalogue. An environment whose virtual environment is missing is left out.

    python benchmarks/zoo/audit.py --venvs FOLDER --results FOLDER --source FOLDER [--only WORD ...]

The source is a checkout of gamekeeper that nobody works in: every audit is by the same code.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent))
from catalogue import Listed, catalogue

AUDIT_S: Final = 90
"""Time limit that the audit is given (`--seconds`)."""
DEFAULT_S: Final = 150
"""The same for audits of the default budget."""
OVER_S: Final = 150
"""Time beyond its limit after which the process is ended: an audit that doesn't keep it."""
SURROUNDINGS: Final = {"SDL_VIDEODRIVER": "dummy", "MPLBACKEND": "Agg"}


def main() -> int:
    """Audits what has no result yet; 0 in any case but wrong use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venvs", type=Path, required=True)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--source", type=Path, required=True, help="checkout whose src is run")
    parser.add_argument("--default", action="store_true", help="default budget, not --quick")
    parser.add_argument("--seconds", type=int, help=f"time limit; {DEFAULT_S}, {AUDIT_S} if quick")
    parser.add_argument("--only", nargs="*", default=[], help="words, one of which a key must hold")
    asked = parser.parse_args()
    for each in one_of_each_first(catalogue()):
        path = asked.results / f"{each.key.replace('/', '+')}.json"
        if path.exists() or (asked.only and not any(word in each.key for word in asked.only)):
            continue
        command = asked.venvs / each.requirements / "bin" / "gamekeeper"
        if not command.exists():
            print(f"{each.key}: no {command}", flush=True)
            continue
        limit_s = asked.seconds or (DEFAULT_S if asked.default else AUDIT_S)
        quick = not asked.default
        result = audited(each, command, asked.source, quick=quick, limit_s=limit_s)
        asked.results.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(result, indent=1))
        print(f"{each.key}: {summary(result)}", flush=True)
    return 0


def one_of_each_first(listed: Iterable[Listed]) -> list[Listed]:
    """The first environment of every package, then the second, and so on."""
    met: Counter[str] = Counter()
    places: list[tuple[int, Listed]] = []
    for each in listed:
        places.append((met[each.package], each))
        met[each.package] += 1
    return [each for _, each in sorted(places, key=lambda place: place[0])]


def audited(
    each: Listed, command: Path, source: Path, *, quick: bool, limit_s: int
) -> dict[str, Any]:
    """One audit's JSON, or what ended it without one."""
    words = [str(command), "audit", each.spec, "--json", "--quiet"]
    words += ["--quick"] if quick else []
    words += ["--seconds", str(limit_s), "--kwargs", json.dumps(dict(each.kwargs))]
    surroundings = {**os.environ, **SURROUNDINGS, "PYTHONPATH": str(source / "src")}
    result: dict[str, Any] = {"key": each.key, "group": each.group, "gamekeeper": _commit(source)}
    result |= {"limit_s": limit_s, "audited": time.strftime("%Y-%m-%d")}
    start = time.monotonic()
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, timeout=limit_s + OVER_S, env=surroundings
        )
    except subprocess.TimeoutExpired:
        end_s = limit_s + OVER_S
        return {**result, "ended": f"no answer in {end_s} s", "seconds": end_s}
    result |= {"returncode": done.returncode, "seconds": round(time.monotonic() - start, 1)}
    try:
        return {**result, "audit": json.loads(done.stdout)}
    except json.JSONDecodeError:
        return {**result, "ended": done.stderr.strip()[-2000:]}


def summary(result: dict[str, Any]) -> str:
    """One line: what failed, what is suspected, how long it took."""
    if "audit" not in result:
        return f"{result['seconds']} s, {result['ended'].splitlines()[-1:]}"
    verdicts = result["audit"].get("verdicts", [])
    failed = [
        f"{each['id']}{'' if each.get('follows_from') is None else '*'}"
        for each in verdicts
        if each["outcome"] == "failed"
    ]
    suspected = [each["id"] for each in verdicts if each["outcome"] == "suspected"]
    return f"{result['seconds']} s, failed {' '.join(failed)}, suspected {' '.join(suspected)}"


def _commit(source: Path) -> str:
    words = ["git", "-C", str(source), "rev-parse", "--short", "HEAD"]
    return subprocess.run(words, capture_output=True, text=True).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
