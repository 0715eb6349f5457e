"""The house stands as planned: imports go down, packages have their place, the pure are pure."""

import ast
from collections.abc import Callable, Iterator

import pytest

from tests.surface.layers import LAYERS, impurities, misplaced_imports, upward_imports
from tests.surface.sources import modules

Rule = Callable[..., Iterator[str]]


def violations(rule: Rule) -> list[str]:
    """What a rule finds in the whole package."""
    found: list[str] = []
    for module, path in modules().items():
        tree = ast.parse(path.read_text(encoding="utf-8"), filename=str(path))
        found += rule(module, tree, is_package=path.name == "__init__.py")
    return found


@pytest.mark.parametrize("rule", [upward_imports, misplaced_imports, impurities])
def test_package_keeps_the_rule(rule: Rule) -> None:
    """No module of the package breaks this rule."""
    assert violations(rule) == []


def test_every_room_has_a_layer() -> None:
    """A new room cannot stand outside the plan."""
    rooms = {name.split(".")[1] for name in modules() if "." in name}
    assert rooms - LAYERS.keys() - {"__main__"} == set()


def test_every_folder_is_a_package() -> None:
    """No folder of modules is a namespace package by accident."""
    folders = {path.parent for path in modules().values()}
    assert [f for f in sorted(folders) if not (f / "__init__.py").is_file()] == []


@pytest.mark.parametrize(
    ("rule", "module", "source"),
    [
        (
            upward_imports,
            "gamekeeper.episodes.episode",
            "from gamekeeper.interface.capture import Capture",
        ),
        (upward_imports, "gamekeeper.episodes.episode", "from ..rollouts import reruns"),
        (
            upward_imports,
            "gamekeeper.runs.load_run",
            "def f():\n    import gamekeeper.vector.serial_engine",
        ),
        (upward_imports, "gamekeeper.plugins", "from gamekeeper import episodes"),
        (upward_imports, "gamekeeper.rollouts.rollout", "from gamekeeper import make"),
        (upward_imports, "gamekeeper.rollouts.rollout", "import gamekeeper"),
        (upward_imports, "gamekeeper.interface.capture", "from gamekeeper.helpers import x"),
        (misplaced_imports, "gamekeeper.runs.load_run", "from pettingzoo import AECEnv"),
        (misplaced_imports, "gamekeeper.rollouts.workers", "import ray"),
        (misplaced_imports, "gamekeeper.auditing.judge", "import pettingzoo.utils.env as env"),
        (impurities, "gamekeeper.contract", "from pathlib import Path"),
        (impurities, "gamekeeper.contract", "text = open('x').read()"),
        (impurities, "gamekeeper.statistics.significance", "x = np.random.default_rng().normal()"),
        (impurities, "gamekeeper.statistics.significance", "np.random.seed(7)"),
        (impurities, "gamekeeper.reporting.results_text", "print('done')"),
        (impurities, "gamekeeper.reporting.html", "import datetime\nnow = datetime.datetime.now()"),
        (impurities, "gamekeeper.checks.gk402", "import os\nhome = os.environ['HOME']"),
        (impurities, "gamekeeper.checks.gk402", "import time"),
    ],
)
def test_rule_finds(rule: Rule, module: str, source: str) -> None:
    """Each rule sees the violation that it is there for."""
    assert len(list(rule(module, ast.parse(source)))) >= 1


@pytest.mark.parametrize(
    ("rule", "module", "source"),
    [
        (
            upward_imports,
            "gamekeeper.episodes.episode",
            "from gamekeeper.errors import EvidenceError",
        ),
        (upward_imports, "gamekeeper.episodes.episode", "from .canonical import json_text"),
        (upward_imports, "gamekeeper.runs.load_run", "from gamekeeper import episodes"),
        (upward_imports, "gamekeeper.cli.run", "from gamekeeper.runs.load_run import load"),
        (misplaced_imports, "gamekeeper.tasks.clean", "from pettingzoo import AECEnv"),
        (
            impurities,
            "gamekeeper.randomness.seeds",
            "rng = np.random.Generator(np.random.PCG64(seed))",
        ),
        (
            impurities,
            "gamekeeper.episodes.canonical",
            "from io import BytesIO\nfrom os import PathLike",
        ),
        (impurities, "gamekeeper.runs.files.store", "import os, time\nopen('x')"),
    ],
)
def test_rule_lets_pass(rule: Rule, module: str, source: str) -> None:
    """No rule refuses what the plan allows."""
    assert list(rule(module, ast.parse(source))) == []


def test_package_imports_are_relative_to_themselves() -> None:
    """One dot in a package's own `__init__` is the package, in its modules it is their folder."""
    inside, outside = ast.parse("from .vector import x"), ast.parse("from ..vector import x")
    assert list(upward_imports("gamekeeper.runs", inside, is_package=True)) == []
    assert list(upward_imports("gamekeeper.runs.load_run", inside)) == []
    assert len(list(upward_imports("gamekeeper.runs.load_run", outside))) == 1
