"""First steps without a test runner: import, audit, rollout, replay, report, under any Python.

    python benchmarks/first_steps.py

Needs the base packages alone. Prints one line, or fails.
"""

from __future__ import annotations

import platform
import tempfile
import time
from pathlib import Path

import gamekeeper as gk

TASK = "two_robot_line"
BUDGET = 500
"""Environment steps of the audit."""


def main() -> None:
    """Takes the steps.

    Raises:
        AssertionError: one came out otherwise than it must.
    """
    start = time.monotonic()
    audit = gk.audit(TASK, budget=BUDGET)
    assert audit.ok, str(audit)
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        evidence = gk.rollout(TASK, policies="reference", episodes=2, seed=0, out=run)
        replayed = gk.replay(run)
        assert replayed.verified, str(replayed)
        assert replayed.fingerprint == evidence.fingerprint
        page = gk.report(run, Path(folder) / "report.html")
        assert page.stat().st_size > 0
    seconds = time.monotonic() - start
    passed = sum(each.outcome == "passed" for each in audit.verdicts)
    version = platform.python_version()
    print(
        f"Python {version}: {passed} checks passed, {replayed.fingerprint[:16]} replayed, "
        f"reported, in {seconds:.0f} s"
    )


if __name__ == "__main__":
    main()
