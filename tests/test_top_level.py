"""The package's front: a public function and a room inside the package may have one name."""

import inspect
import subprocess
import sys

import pytest

import gamekeeper as gk
from tests.cli.lines import SURROUNDINGS

ORDERS = [
    "import gamekeeper as gk",
    "import gamekeeper as gk; gk.rollout",
    "import gamekeeper.runs.load_run, gamekeeper as gk",
    "import gamekeeper as gk; gk.record; import gamekeeper.runs.recording",
]


@pytest.mark.parametrize("order", ORDERS)
def test_record_is_called_whatever_was_imported_before(order: str) -> None:
    """`gk.record(...)` is the function, also where the package of that name was imported first."""
    code = f"{order}\nassert callable(gk.record)\nfrom gamekeeper.runs import load_run"
    subprocess.run([sys.executable, "-c", code], env=SURROUNDINGS, check=True)


def test_room_shows_the_signature_of_its_function() -> None:
    """Editors and `help` see the arguments of the function behind a package."""
    assert list(inspect.signature(gk.record).parameters)[:2] == ["env", "path"]


def test_draft_contract_leaves_an_object_open() -> None:
    """What a user hands over stays usable; what was opened for the draft alone is closed."""
    env = gk.make("examples/two_robot_line.py:make")
    closed: list[str] = []
    env.close = lambda: closed.append("object")  # type: ignore[method-assign]
    assert gk.draft_contract(env).name == "two_robot_line_v0"
    assert closed == []


def test_python_m_gamekeeper_is_the_command_line() -> None:
    """`python -m gamekeeper` works where the console script isn't on the path."""
    done = subprocess.run(
        [sys.executable, "-m", "gamekeeper", "--version"],
        env=SURROUNDINGS,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == f"gamekeeper {gk.__version__}\n"


def test_evidence_has_every_documented_name() -> None:
    """What others read of evidence stays, also where nothing of ours reads it."""
    evidence = gk.rollout("two_robot_line", episodes=1, seed=0)
    names = "manifest contract fingerprint episodes agent_steps states facts to_pandas"
    assert [name for name in names.split() if not hasattr(evidence, name)] == []
