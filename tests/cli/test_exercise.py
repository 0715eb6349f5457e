"""The worked exercise in the docs is true: its command, its rules and its tests run as printed."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.lines import document, run_apart, said
from tests.cli.test_new import pytest_in
from tests.surface.sources import ROOT

PAGE = (ROOT / "docs" / "tutorials" / "write-a-task.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)


def block(kind: str, start: str) -> str:
    """The block of code that begins so."""
    return next(text for found, text in BLOCKS if found == kind and text.startswith(start))


@pytest.fixture
def package(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Path:
    """The package of the exercise, as its reader has it in the end."""
    monkeypatch.chdir(tmp_path)
    words = shlex.split(block("bash", "gamekeeper new").replace("\\\n", " "))
    code, out, err = said(capfd, *words[1:])
    assert code == 0, err
    assert out.startswith(block("", "Advice"))
    folder = tmp_path / "door_task"
    for path in ("src/door_task/env.py", "tests/test_rules.py"):
        (folder / path).write_text(block("python", f"# {path}"), encoding="utf-8")
    contract = folder / "src" / "door_task" / "door_task.toml"
    kept = contract.read_text(encoding="utf-8").partition("[infos]")[0]
    contract.write_text(kept + block("toml", "# src"), encoding="utf-8")
    return folder


def test_exercise_passes_its_tests(package: Path) -> None:
    """A test for each rule, and what holds whatever the rules are."""
    done = pytest_in(package, src=[])
    assert done.returncode == 0, done.stdout


def test_exercise_is_made_by_its_id(package: Path) -> None:
    """Those who use PettingZoo alone make it as they make others."""
    text = "import sys; sys.path.insert(0, 'src')\n" + block("python", "import pettingzoo")
    text += "assert env.possible_agents == ['holder_0', 'carrier_0']\n"
    subprocess.run([sys.executable, "-c", text], cwd=package, check=True)


def test_exercise_is_solved_and_replays(
    package: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reference delivers, verified; an ending of one agent leaves the other."""
    spec = "src/door_task/env.py:DoorTask"
    done = run_apart("run", spec, "--policy", "reference", cwd=package)
    assert done.returncode == 0, done.stderr
    assert "verified: fingerprint" in done.stdout
    assert "delivered 20" in done.stdout
    monkeypatch.chdir(package)
    line = shlex.split(block("bash", "gamekeeper rollout"))
    _, told = document(capfd, *line[1:])
    holder, carrier = told["agents"]["holder_0"], told["agents"]["carrier_0"]
    assert holder["endings"] == {"battery": 20}
    assert holder["return_mean"] == pytest.approx(-0.12)
    assert carrier["endings"] == {"horizon": 20}
    assert (carrier["return_mean"], carrier["idle"]) == (0.0, 1.0)
