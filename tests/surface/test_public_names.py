"""The names that users import: a list kept by hand, each name there, explained, told of."""

import ast
import inspect
import subprocess
import sys

import pytest

import gamekeeper
from gamekeeper import errors
from tests.surface.sources import ROOT, kept_files

# A name is added here on purpose, and never taken away without a fragment in changelog.d/.
PUBLIC = [
    "ActionError",
    "Attribution",
    "AuditResult",
    "CheckedClaim",
    "Contract",
    "ContractError",
    "DependencyError",
    "Diagnosis",
    "Divergence",
    "DivergenceError",
    "DrawError",
    "EnvError",
    "Episode",
    "Evaluation",
    "Evidence",
    "EvidenceError",
    "Finding",
    "GamekeeperError",
    "OrderError",
    "Pivots",
    "PolicyError",
    "Replay",
    "ResponseTest",
    "Resumed",
    "RunError",
    "SpecError",
    "TickEnv",
    "TrustError",
    "Turn",
    "TurnEnv",
    "Verdict",
    "Verification",
    "attribute",
    "audit",
    "diagnose",
    "diff",
    "draft_contract",
    "errors",
    "evaluate",
    "expand",
    "load",
    "make",
    "pack",
    "pivots",
    "player",
    "plot",
    "record",
    "replay",
    "report",
    "reproduce",
    "responses",
    "resume",
    "rollout",
    "to_aec",
    "to_parallel",
    "vector",
    "verify",
    "wrappers",
]
TEXTS = [path for path in kept_files() if path.suffix == ".md" and "decisions" not in path.parts]


def test_public_names_are_these() -> None:
    """`gamekeeper.__all__` is the list above, no more and no less, sorted."""
    assert list(gamekeeper.__all__) == PUBLIC


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_is_there_and_explained(name: str) -> None:
    """Each name loads, shows in `dir`, and its docstring claims something."""
    thing = getattr(gamekeeper, name)
    assert name in dir(gamekeeper)
    assert inspect.getdoc(thing)


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_stands_in_the_docs(name: str) -> None:
    """Each name is written somewhere as users type it: `gk.name`."""
    assert any(f"gk.{name}" in path.read_text(encoding="utf-8") for path in TEXTS)


APART = """
import os, sys
import gymnasium, numpy, pettingzoo, pyarrow  # what nearly all of them load, once

for name in sys.argv[1:]:
    if os.fork() == 0:
        exec(f"from gamekeeper import {name}; print({name}.__name__)")
        sys.stdout.flush()
        os._exit(0)
    if os.wait()[1]:
        sys.exit(f"{name} doesn't load alone")
"""


def test_public_names_load_alone() -> None:
    """Each loads first in a process of its own: none leans on what another one imported."""
    homes = {getattr(getattr(gamekeeper, name), "__module__", name): name for name in PUBLIC}
    done = subprocess.run(
        [sys.executable, "-c", APART, *homes.values()],
        cwd=ROOT / "src",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == len(homes)


def test_every_error_is_a_public_name() -> None:
    """Whoever catches an error of ours finds its class, and the tree, right after the import."""
    code = "import gamekeeper as gk; print(*vars(gk), *vars(gk.errors))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT / "src", capture_output=True, text=True, check=True
    )
    tree = [
        name for name, each in vars(errors).items() if str(each).startswith("<class 'gamekeeper")
    ]
    assert set(tree) <= set(done.stdout.split()) & set(PUBLIC)


def test_type_checkers_see_what_loads_late() -> None:
    """Each name that loads when it is first used is imported for type checkers as well."""
    source = ast.parse((ROOT / "src" / "gamekeeper" / "__init__.py").read_text("utf-8"))
    (late,) = (node for node in source.body if isinstance(node, ast.If))
    seen = {n.name for each in late.body if isinstance(each, ast.ImportFrom) for n in each.names}
    eager = {name for name in PUBLIC if name in vars(gamekeeper) and hasattr(errors, name)}
    assert set(PUBLIC) - seen - eager == {"draft_contract", "errors", "make"}  # defined right there


def test_public_functions_are_functions_whatever_was_imported() -> None:
    """No package bears a function's name, so `help(gk.record)` shows the function, always."""
    packages = {path.parent.name for path in (ROOT / "src" / "gamekeeper").glob("*/__init__.py")}
    functions = {name for name in PUBLIC if inspect.isfunction(getattr(gamekeeper, name))}
    assert {"audit", "diagnose", "evaluate", "record", "report"} <= functions
    assert not packages & functions
    assert set(PUBLIC) & packages == {"vector"}  # `gk.vector.make`


def test_unknown_name_is_refused() -> None:
    """A name that isn't there raises AttributeError, as of any module."""
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = gamekeeper.no_such_name


def test_version_is_that_of_the_package() -> None:
    """`gamekeeper.__version__` is what pyproject.toml says."""
    assert f'version = "{gamekeeper.__version__}"' in (ROOT / "pyproject.toml").read_text("utf-8")
