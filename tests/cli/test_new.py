"""`gamekeeper new`: what it writes works, and what it asks it understands."""

import ast
import io
import itertools
import os
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.contract import Contract
from tests.cli.lines import SURROUNDINGS, document, said

AEC = (
    "--agents picker=2 --agents carrier --stages picker,carrier --sees yes "
    "--observes box:6 --acts picker=discrete:4 --acts carrier=box:2 "
    "--reward grasp=individual:picker --reward delivery=shared:carrier:all "
    "--ending done=termination:all --ending battery=truncation:agent"
)
PARALLEL = "--agents robot=3 --reward duel=zero-sum --ending home=termination:agent --horizon 30"
VARIANTS = {
    "rotating": "--agents a=3 --agents b=2 --order rotating --sees yes --observes a=discrete:4 "
    "--observes b=multidiscrete:3,4 --acts a=box:2x2 --acts b=multibinary:3",
    "state": "--agents a=3 --order state --acts multidiscrete:3,3,2 --observes multibinary:9 "
    "--ending out=truncation:all --ending fell=truncation:agent",
    "random": "--agents a=2 --agents b=2 --order random --conflicts ordered --observes box:2x3 "
    "--ending home=termination:b --ending crash=termination:all",
    "buffered": "--agents a=2 --agents b=2 --stages a,b --sees yes --order none --conflicts random "
    "--ending home=termination:agent --observes discrete:9",
    "hidden": "--agents a=3 --order rotating --conflicts ordered --observes box:2",
    "crate": "--agents a=3 --conflicts priority --reward prize=individual",
    "staged": "--agents a=2 --agents b=2 --stages b,a --ending home=termination:agent "
    "--ending gone=truncation:a --reward x=individual --reward y=shared:a:b",
    "short": "--agents a --horizon 1 --api aec",
}


def pytest_in(folder: Path, *arguments: str, src: list[Path]) -> subprocess.CompletedProcess[str]:
    """What pytest says in a process of its own, as a user runs it."""
    paths = [*map(str, src), SURROUNDINGS["PYTHONPATH"]]
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def yaml_of(path: Path) -> Any:
    """What a YAML file says."""
    return pytest.importorskip("yaml").safe_load(path.read_text("utf-8"))


def audit_of_ci(folder: Path) -> list[str]:
    """The words of the last line of a package's CI, which audits it."""
    workflow = yaml_of(folder / ".github/workflows/tests.yml")
    runs = [step["run"] for step in workflow["jobs"]["audit"]["steps"] if "run" in step]
    return str(runs[-1]).split()


def test_new_package_passes_its_own_tests(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A package is written, and all its tests pass at once, without a warning."""
    code, told = document(capfd, "new", "my_task", *AEC.split(), "--out", tmp_path / "my_task")
    assert (code, told["api"], told["advice"]) == (0, "aec", "aec")
    done = pytest_in(tmp_path / "my_task", src=[])
    assert done.returncode == 0, done.stdout
    assert "warning" not in done.stdout


@pytest.mark.parametrize(
    "answers", [AEC, PARALLEL, VARIANTS["rotating"]], ids=["aec", "parallel", "rotating"]
)
def test_new_package_has_sound_types(
    answers: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """`mypy --strict`, `ruff check` and `ruff format` find nothing in a package, tests included."""
    document(capfd, "new", "my_task", *answers.split(), "--yes", "--out", tmp_path)
    programs = (
        ["mypy", "--strict", "."],
        ["ruff", "check", "--no-cache", "."],
        ["ruff", "format", "--no-cache", "--check", "."],
    )
    for words in programs:
        done = subprocess.run(
            [sys.executable, "-m", *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            timeout=240,
        )
        assert done.returncode == 0, done.stdout


def test_new_package_passes_the_audit_of_its_ci(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line with which a package's CI audits it, typed in its folder, finds nothing broken."""
    document(capfd, "new", "my_task", *PARALLEL.split(), "--out", tmp_path)
    monkeypatch.chdir(tmp_path)
    words, told = audit_of_ci(tmp_path), "src/my_task/env.py:MyTask"
    assert words == ["gamekeeper", "audit", told, "--quick", "--out", "audits"]
    code, audit = document(capfd, *words[1:])
    assert (code, audit["ok"], audit["environment"]) == (0, True, told)
    by_outcome = Counter(verdict["outcome"] for verdict in audit["verdicts"])
    assert set(by_outcome) <= {"passed", "not_exercised", "not_applicable"}
    assert by_outcome["passed"] > sum(by_outcome.values()) / 2
    assert (tmp_path / "audits" / "junit.xml").is_file()


def test_new_package_fails_the_audit_of_its_ci_once_it_is_broken(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rule that draws from NumPy's global generator stops the build, and is told by its check."""
    document(capfd, "new", "my_task", "--yes", "--out", tmp_path)
    module = tmp_path / "src/my_task/env.py"
    text, drawn = module.read_text("utf-8"), "rng.integers(1, FURTHEST + 1)"
    assert text.count(drawn) == 1
    module.write_text(text.replace(drawn, "int(np.random.randint(1, FURTHEST + 1))"), "utf-8")
    monkeypatch.chdir(tmp_path)
    code, audit = document(capfd, *audit_of_ci(tmp_path)[1:], "--select", "GK602")
    assert (code, audit["ok"]) == (1, False)
    broken = [verdict for verdict in audit["verdicts"] if verdict["outcome"] == "failed"]
    assert broken
    programs = [tmp_path / "audits" / f"{verdict['id']}.py" for verdict in broken]
    assert [path for path in programs if not path.is_file()] == []


def test_new_rules_hold_in_every_form(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Orders, stages, spaces, terms and endings of every kind: the tests of rules pass."""
    for name, flags in VARIANTS.items():
        folder = tmp_path / f"{name}-project"
        code, _, error = said(capfd, "new", f"{name}_task", *flags.split(), "--out", folder)
        assert code == 0, error
    select = ["-k", "test_r or pettingzoo", "--import-mode=importlib", "-W", "ignore::UserWarning"]
    done = pytest_in(tmp_path, *select, src=sorted(tmp_path.glob("*/src")))
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("flags", [AEC, PARALLEL, *VARIANTS.values()])
def test_new_files_are_well_formed(
    flags: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Python, TOML and contract can be read; no line is longer than 100 columns."""
    _, told = document(capfd, "new", "a-task", *flags.split(), "--out", tmp_path)
    assert told["name"] == "a_task"
    written = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    assert written == set(told["files"])
    for name in told["files"]:
        text = (tmp_path / name).read_text("utf-8")
        if name.endswith(".py"):
            ast.parse(text)
            assert [line for line in text.splitlines() if len(line) > 100] == []
    contract = Contract.parse((tmp_path / "src/a_task/a_task.toml").read_text("utf-8"))
    assert (contract.name, contract.api) == ("a_task_v0", told["api"])
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text("utf-8"))
    assert project["project"]["entry-points"]["gamekeeper.tasks"] == {"a_task": "a_task"}
    workflow = yaml_of(tmp_path / ".github/workflows/tests.yml")
    runs = {
        name: [step["run"] for step in job["steps"] if "run" in step]
        for name, job in workflow["jobs"].items()
    }
    assert list(runs) == ["tests", "audit"]
    assert runs["tests"][-1] == "python -m pytest"
    assert runs["audit"] == [
        "python -m pip install -e .",
        "gamekeeper audit src/a_task/env.py:ATask --quick --out audits",
    ]


def test_new_says_what_comes_next(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The advice with its reason, the files, and the commands to type; in 80 columns."""
    monkeypatch.chdir(tmp_path)
    code, out, _ = said(capfd, "new", "my_task", "--yes")
    assert code == 0
    assert out.startswith("Advice    parallel: agents don't observe others' actions")
    assert "gamekeeper audit src/my_task/env.py:MyTask --quick\n" in out
    assert "gamekeeper run src/my_task/env.py:MyTask --policy reference" in out
    assert max(map(len, out.splitlines())) <= 80
    assert (tmp_path / "my_task" / "src" / "my_task" / "env.py").is_file()


class Typed(io.StringIO):
    """A terminal on which somebody types."""

    def isatty(self) -> bool:
        return True


def typed(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    """Puts a person in front of the next command; after the lines given, only Enter."""
    monkeypatch.setattr(sys, "stdin", Typed("\n".join([*lines, *[""] * 20, ""])))


def test_new_asks_and_understands(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Answers make the task; what can't be read is asked again; Enter takes what is usual."""
    typed(
        monkeypatch,
        *("picker=2 carrier=one", "picker=2 carrier"),  # the first one can't be read
        *("picker,carryer", "picker,carrier", "yes", "fixed", "", ""),
        *("box:8", "discrete:6", "box:8", "discrete:5"),
        *("grasp=individual:picker delivery=shared:carrier:all", "", "50"),
    )
    code, out, err = said(capfd, "new", "my_task", "--out", tmp_path)
    assert code == 0, err
    assert "expected: whole numbers from 1 to 100000" in err
    assert "each once of carrier, picker" in err
    assert (
        "Advice: aec, because carrier must observe the actions of picker in the same round." in err
    )
    assert "Which PettingZoo API? (aec, parallel) [aec]" in err
    contract = Contract.parse((tmp_path / "src/my_task/my_task.toml").read_text("utf-8"))
    assert contract.schedule.stages == (("picker",), ("carrier",))
    assert contract.schedule.horizon == 50
    assert list(contract.rewards) == ["grasp", "delivery"]
    assert "Discrete(6)" in (tmp_path / "src/my_task/env.py").read_text("utf-8")
    assert "Agents" not in out


def test_new_asks_only_what_no_option_says(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An option is an answer: nothing that is known is asked."""
    typed(monkeypatch)
    flags = "--agents robot=2 --sees no --order none --observes box:4 --acts robot=discrete:5"
    _, _, err = said(capfd, "new", "my_task", *flags.split(), "--out", tmp_path, "--horizon", "9")
    for word in (
        "Agents:",
        "acts together",
        "same round before it",
        "Observation space",
        "Action space",
        "Length of",
    ):
        assert word not in err
    for word in ("Which rule settles", "Which PettingZoo API?", "Reward terms", "Endings"):
        assert word in err


def test_new_may_be_left(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-D in the middle of the questions interrupts: exit 130, and nothing is written."""
    monkeypatch.setattr(sys, "stdin", Typed("picker=2\n"))
    code, out, err = said(capfd, "new", "my_task", "--out", tmp_path / "new")
    assert (code, out) == (130, "")
    assert "fault of gamekeeper" not in err
    assert not (tmp_path / "new").exists()


def test_new_follows_a_person_against_its_advice(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The other interface is written where it is asked for, and the contract says so."""
    _, told = document(capfd, "new", "my_task", "--api", "aec", "--out", tmp_path)
    assert (told["api"], told["advice"]) == ("aec", "parallel")
    contract = Contract.parse((tmp_path / "src/my_task/my_task.toml").read_text("utf-8"))
    assert contract.why is not None
    assert contract.why.startswith("chosen by its author; parallel would fit, because")
    assert (contract.schedule.order, contract.schedule.observe) == ("none", "after tick")


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["my task"], "can't have this name"),
        (["json"], "can't have this name"),
        (["class"], "can't have this name"),
        (["numpy"], "can't have this name"),
        (["x", "--agents", "Picker=2"], "small letters"),
        (["x", "--agents", "a=0"], "from 1"),
        (["x", "--agents", "a", "--agents", "a=2"], "its own name"),
        (["x", "--agents", "all=2"], "its own name"),
        (["x", "--agents", "a_1=2"], "without a number"),
        (["x", "--agents", "a", "--stages", "a,b"], "each of a once"),
        (["x", "--agents", "a", "--agents", "b", "--stages", "a"], "each of a, b once"),
        (["x", "--stages", "robot,"], "joined by"),
        (["x", "--observes", "image"], "discrete:N"),
        (["x", "--acts", "discrete:1"], "discrete:N"),
        (["x", "--acts", "box"], "discrete:N"),
        (["x", "--acts", "discrete:3,3"], "discrete:N"),
        (["x", "--acts", "box:9x99x999x9"], "discrete:N"),
        (["x", "--acts", "arm=discrete:3"], "ROLE of robot"),
        (["x", "--reward", "a=common"], "KIND of individual"),
        (["x", "--reward", "a=shared:arm"], "robot"),
        (["x", "--reward", "a=shared:all:all:all"], "at most 3"),
        (["x", "--reward", "a", "--reward", "a"], "KIND of"),
        (["x", "--reward", "a=individual:robot:all"], "paid to its earner"),
        (["x", "--agents", "a", "--reward", "z=zero-sum"], "two agents"),
        (["x", "--reward", "a=shared:all:earner"], "payee"),
        (["x", "--ending", "horizon"], "not horizon"),
        (["x", "--ending", "a=end"], "KIND of termination"),
        (["x", "--ending", "a=termination:arm"], "agent, all, robot"),
        (["x", "--sees", "yes", "--api", "parallel"], "before its tick is over"),
        (["x", "--sees", "yes", "--order", "none"], "--order fixed, rotating, random or state"),
        (["x", "--sees", "no", "--order", "rotating"], "a rotating order that no agent observes"),
    ],
)
def test_new_refuses_what_it_cannot_write(
    flags: list[str], words: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A wrong answer names itself and what would be right; exit 2, and nothing is written."""
    code, out, err = said(capfd, "new", *flags, "--out", tmp_path / "new")
    assert (code, out) == (2, "")
    assert words in err
    assert not (tmp_path / "new").exists()


def test_new_overwrites_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A folder that holds something is left as it is; a file in the way is told."""
    (tmp_path / "notes.txt").write_text("mine", "utf-8")
    for out in (tmp_path, tmp_path / "notes.txt", tmp_path / "notes.txt" / "deeper"):
        code, _, err = said(capfd, "new", "my_task", "--out", out)
        assert code == 2
        assert "GamekeeperError" in err
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_new_refuses_a_read_only_folder(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where nothing may be written, the error says so."""

    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    code, _, err = said(capfd, "new", "my_task", "--out", tmp_path / "new")
    assert code == 2
    assert "Permission denied" in err


def test_new_same_answers_same_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Nothing in what is written depends on anything but the answers."""
    for name in ("one", "two"):
        said(capfd, "new", "my_task", *AEC.split(), "--out", tmp_path / name)
    texts = [
        {str(p.relative_to(tmp_path / name)): p.read_text("utf-8") for p in files}
        for name, files in itertools.groupby(
            sorted(p for p in tmp_path.rglob("*") if p.is_file()),
            key=lambda path: path.relative_to(tmp_path).parts[0],
        )
    ]
    assert texts[0] == texts[1]
