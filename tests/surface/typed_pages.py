"""Pages as a reader types them.

On every page the blocks are typed one after another in one folder, in which `make demo` has left
its evidence: Python in one namespace, `gamekeeper` lines one by one, SQL by DuckDB. A block whose
first line is a comment with a file's name is saved there; a diff is made in the file that it
names. Only the numbers of episodes are smaller, and of steps of audits that find nothing;
and one worker plays where otherwise each core has one: results are the same, and starting a worker
takes longer than what it plays. What can't run says why, in an HTML comment above it:
`<!-- not run: reason -->`.
"""

import contextlib
import re
import shlex
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.auditing import audit_process
from gamekeeper.cli import main
from tests.surface.sources import ROOT

duckdb = pytest.importorskip("duckdb")
pytest.importorskip(
    "pandas"
)  # a page reads evidence with it; loaded before workers lose sight of it

BLOCK = re.compile(
    r"(?:^<!-- not run: (?P<why>.+?) -->\n)?^```(?P<kind>\w*)\n(?P<text>.*?)^```$", re.M | re.S
)
FILE = re.compile(r"# ([\w./-]+\.(?:py|toml))\n")
FEWER = {"episodes=20": "episodes=2", "episode == 750": "episode == 150"}
"""Numbers of episodes that code plays, and that the tests play in their place."""
AUDITED = 1_000
"""Env steps of the audit with which `gamekeeper run` begins."""
TYPED = ("python", "sh", "sql", "toml", "diff")
CODE = re.compile(r"exit code (\d)")


@dataclass(frozen=True)
class Block:
    """A block of code on a page."""

    kind: str
    text: str
    why_not: str | None


def blocks_of(page: Path) -> list[Block]:
    """The blocks of a page, in their order."""
    found = BLOCK.finditer(page.read_text(encoding="utf-8"))
    return [Block(each["kind"], each["text"], each["why"]) for each in found]


def short(page: Path) -> str:
    """A page as it stands in the repository."""
    return str(page.relative_to(ROOT))


def run_python(text: str, known: dict[str, Any]) -> None:
    """Runs a block in the page's namespace."""
    exec(compile(fewer(text), "<docs>", "exec"), known)


def fewer(text: str) -> str:
    """The code, with fewer episodes."""
    for many, few in FEWER.items():
        text = text.replace(many, few)
    return text


def smaller(words: list[str]) -> list[str]:
    """Options that make a command's work smaller, where it doesn't say how much it wants."""
    few = {"run": "--episodes 2", "rollout": "--episodes 2"}
    few |= {"evaluate": "--workers 1", "diagnose": "--workers 1", "attribute": "--episodes 4"}
    option = few.get(words[1], "").split()
    return [] if set(option) & set(words) else option


def run_lines(text: str) -> None:
    """Runs a block's `gamekeeper` and `pytest` lines; each exits as its comment says, or with 0."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        told = CODE.search(line.partition("#")[2])
        if words[0] == "pytest":
            plugin = ["-p", "gamekeeper.testing", "-p", "no:cacheprovider"]
            done = subprocess.run([sys.executable, "-m", "pytest", *plugin, *words[1:]])
            assert done.returncode == (int(told[1]) if told else 0), line
            continue
        assert words[0] == "gamekeeper", f"nobody runs this line: {line}"
        words += smaller(words)
        is_sound = words[1] == "audit" and told is None
        if is_sound and "--quick" not in words and not Path(words[2]).is_dir():
            words.append("--quick")
        steps = AUDITED if words[1] == "run" or is_sound else audit_process.QUICK
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(audit_process, "QUICK", steps)
            assert main(words[1:]) == (int(told[1]) if told else 0), line


def fix(text: str) -> None:
    """Makes a diff's changes; what each replaces stands once in the file."""
    head, *hunks = re.split(r"^@@.*\n", text, flags=re.M)
    path = Path(head.removeprefix("---").strip())
    told = path.read_text(encoding="utf-8")
    for hunk in hunks:
        lines = hunk.splitlines(keepends=True)
        old = "".join(x[1:] for x in lines if x[0] != "+")
        assert told.count(old) == 1, f"not once in {path}:\n{old}"
        told = told.replace(old, "".join(x[1:] for x in lines if x[0] != "-"))
    path.write_text(told, encoding="utf-8")


def run_block(block: Block, known: dict[str, Any]) -> None:
    """Saves, runs or reads a block, as its kind and its first line say."""
    name = FILE.match(block.text)
    if block.kind == "toml":
        tomllib.loads(block.text)
    if name is not None:
        Path(name[1]).write_text(fewer(block.text), encoding="utf-8")
    elif block.kind == "python":
        run_python(block.text, known)
    elif block.kind == "sh":
        run_lines(block.text)
    elif block.kind == "diff":
        fix(block.text)
    elif block.kind == "sql":
        assert duckdb.sql(block.text).fetchall(), block.text


def at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a reader is: a folder with the demo's evidence and an environment in `my_env.py`."""
    text = (ROOT / "examples" / "two_robot_line.py").read_text(encoding="utf-8")
    (tmp_path / "my_env.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    # pyarrow imports pandas where it can, which takes a worker longer than all it has to do here.
    (hidden / "pandas.py").write_text("raise ImportError('hidden by the tests')", encoding="utf-8")
    monkeypatch.syspath_prepend(hidden)
    gk.rollout("two_robot_line", episodes=2, out="runs/demo")
    return tmp_path


def type_page(page: Path, folder: Path) -> None:
    """Runs every block of a page, after those before it; each has to exit as it says."""
    known: dict[str, Any] = {"__name__": "docs"}
    with contextlib.ExitStack() as stack:
        stack.callback(forget, folder)
        for block in blocks_of(page):
            if block.why_not is None and block.kind in TYPED:
                run_block(block, known)


def forget(folder: Path) -> None:
    """Forgets the modules of a page, so that another page may have one of that name."""
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None) or "").startswith(str(folder)):
            del sys.modules[name]
