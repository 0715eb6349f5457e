"""Command lines as tests type them: in this process, or in one of their own."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.cli import main
from tests.surface.sources import ROOT

ROUGH = f"{Path(__file__).with_name('rough_env.py')}:make"
LINE = f"{ROOT / 'examples' / 'two_robot_line.py'}:make"
SURROUNDINGS = {
    **os.environ,
    "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]),
    "PYTHONWARNINGS": "default",
}


def rough(**settings: Any) -> list[str]:
    """The arguments that name the rough environment with these settings."""
    return [ROUGH, "--kwargs", json.dumps(settings)]


def failing(how: str, out: Path) -> list[object]:
    """A recording into `out` of an environment that goes wrong once rows of it lie there.

    Only one that hangs is given up soon: on a busy machine the others' turns may take seconds.
    """
    settings = {"how": how, "after": str(out), "length": 10**9, "tick_s": 0.001}
    patience = ["--timeout", "5"] if how == "hang" else []
    return ["rollout", *rough(**settings), "--out", out, *patience]


def said(capture: pytest.CaptureFixture[str], *line: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command line that is run in this process."""
    capture.readouterr()
    code = main([str(word) for word in line])
    out, err = capture.readouterr()
    return code, out, err


def document(capture: pytest.CaptureFixture[str], *line: object) -> tuple[int, Any]:
    """Exit code and the one document of a command line with --json."""
    code, out, _ = said(capture, *line, "--json")
    return code, json.loads(out, parse_constant=pytest.fail)


def run_apart(*line: object, cwd: Path, **settings: Any) -> subprocess.CompletedProcess[str]:
    """A command line that is run in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "gamekeeper", *map(str, line)],
        cwd=cwd,
        env={**SURROUNDINGS, **settings.pop("env", {})},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        **settings,
    )
