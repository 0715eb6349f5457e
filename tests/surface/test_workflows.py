"""The workflow files are whole: they parse, ask for little, and name what is there.

They run elsewhere; this sees what would stop them before they begin.
"""

import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.surface.sources import ROOT

yaml = pytest.importorskip("yaml")

FOLDER = ROOT / ".github" / "workflows"
FILES = sorted(path.name for path in FOLDER.glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PIN = re.compile(r"[\w.-]+/[\w./-]+@(v\d+|release/v\d+)")
GRANTED = {"ci.yml": set(), "docs.yml": {"pages", "id-token"}, "release.yml": {"id-token"}}


def workflow(name: str) -> dict[Any, Any]:
    """A workflow as GitHub reads it; YAML reads its key `on` as true."""
    found = yaml.safe_load((FOLDER / name).read_text(encoding="utf-8"))
    return {"on" if key is True else key: value for key, value in found.items()}


def steps(name: str) -> list[dict[str, Any]]:
    """The steps of all jobs of a workflow."""
    return [step for job in workflow(name)["jobs"].values() for step in job["steps"]]


def test_workflows_are_these() -> None:
    """Checking, pages, releases."""
    assert sorted(GRANTED) == FILES


@pytest.mark.parametrize("name", FILES)
def test_workflow_may_little(name: str) -> None:
    """Reading is all that a workflow may; what a job needs beyond is granted to it alone."""
    found = workflow(name)
    assert found["permissions"] == {"contents": "read"}
    wider = [job.get("permissions", {}) for job in found["jobs"].values()]
    assert {scope for each in wider for scope in each} == GRANTED[name]
    text = (FOLDER / name).read_text(encoding="utf-8")
    assert "secrets." not in text
    assert "pull_request_target" not in text


@pytest.mark.parametrize("name", FILES)
def test_workflow_has_whole_jobs(name: str) -> None:
    """Every job has a machine and a time limit, every action a version, every wait its job."""
    found = workflow(name)
    for job in found["jobs"].values():
        assert {"runs-on", "timeout-minutes", "steps"} <= job.keys()
        needs = job.get("needs", [])
        assert set([needs] if isinstance(needs, str) else needs) <= found["jobs"].keys()
        assert all(("uses" in step) != ("run" in step) for step in job["steps"])
    assert [s["uses"] for s in steps(name) if "uses" in s and not PIN.fullmatch(s["uses"])] == []


@pytest.mark.parametrize("name", FILES)
def test_workflow_names_what_is_there(name: str) -> None:
    """Targets of make, scripts, locks and folders of tests that its commands name exist."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    commands = "\n".join(step["run"] for step in steps(name) if "run" in step)
    targets = re.findall(r"\bmake ([\w-]+)", commands)
    assert [t for t in targets if not re.search(rf"^{t}:", makefile, flags=re.M)] == []
    words = shlex.split(commands, comments=True)
    named = [w for w in words if w.startswith(("tests/", "requirements/", ".ci/", "examples/"))]
    assert [word for word in named if not Path(ROOT / word).exists()] == []


def test_workflows_cover_the_pythons_we_name() -> None:
    """Every version among the classifiers is run."""
    prefix = "Programming Language :: Python :: "
    named = {text.removeprefix(prefix) for text in PROJECT["classifiers"] if f"{prefix}3." in text}
    run = {str(step.get("with", {}).get("python-version")) for step in steps("ci.yml")}
    run |= set(workflow("ci.yml")["jobs"]["tests"]["strategy"]["matrix"]["python"])
    assert named <= run
