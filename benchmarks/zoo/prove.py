"""Reproducers that an audit had no time for, run afterwards.

A suspected verdict whose reproducer was not run as the audit's time was over is run here up to five
times, until it passes once; the result is kept beside the audit, under "proved".

    python benchmarks/zoo/prove.py --venvs FOLDER --results FOLDER
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent))
from audit import SURROUNDINGS
from catalogue import catalogue

UNTRIED: Final = "the audit ended before its reproducer was run"
TRIES: Final = 5
TRY_S: Final = 120
"""Time limit of one try."""


def main() -> int:
    """Runs what wasn't run; 0 in any case but wrong use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venvs", type=Path, required=True)
    parser.add_argument("--results", type=Path, required=True)
    asked = parser.parse_args()
    for each in catalogue():
        path = asked.results / f"{each.key.replace('/', '+')}.json"
        if not path.exists():
            continue
        python = asked.venvs / each.requirements / "bin" / "python"
        result = json.loads(path.read_text())
        for verdict in untried(result):
            shown = tried(python, verdict["findings"][0]["reproducer"])
            result.setdefault("proved", {})[verdict["id"]] = shown
            path.write_text(json.dumps(result, indent=1))
            print(f"{each.key} {verdict['id']}: {shown['failed']} of {shown['tried']}", flush=True)
    return 0


def untried(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Suspected verdicts of severity high or medium whose reproducer nobody has run."""
    return [
        verdict
        for verdict in (result.get("audit") or {}).get("verdicts", ())
        if verdict["outcome"] == "suspected"
        and verdict["severity"] != "low"
        and verdict.get("reason") == UNTRIED
        and verdict["id"] not in result.get("proved", {})
    ]


def tried(python: Path, program: str) -> dict[str, Any]:
    """Counts of tries and of failures, and the last line of the last one."""
    said, failed = "", 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "reproducer.py")
        path.write_text(program)
        for number in range(1, TRIES + 1):
            try:
                done = subprocess.run(
                    [str(python), str(path)],
                    capture_output=True,
                    text=True,
                    timeout=TRY_S,
                    env={**os.environ, **SURROUNDINGS},
                    cwd=folder,
                )
            except subprocess.TimeoutExpired:
                return {"failed": failed, "tried": number, "said": f"no end in {TRY_S} s"}
            if done.returncode == 0:
                return {"failed": failed, "tried": number, "said": said}
            failed += 1
            said = " ".join(done.stderr.strip().splitlines()[-1:])[-300:]
    return {"failed": failed, "tried": TRIES, "said": said}


if __name__ == "__main__":
    sys.exit(main())
