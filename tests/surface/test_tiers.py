"""Tiers of tests: by measured seconds only, and every test in one of them."""

import ast
from types import SimpleNamespace
from typing import Any

import pytest

from tests.tiers import FILE, LIMIT_S, ROOT, Tiers, later, measured


class Hooks:
    """Stands for pytest's configuration: keeps what was deselected."""

    def __init__(self) -> None:
        self.left: list[Any] = []
        self.hook = SimpleNamespace(pytest_deselected=lambda items: self.left.extend(items))


def test_every_test_is_in_one_tier(monkeypatch: pytest.MonkeyPatch) -> None:
    """Quick and slow together are all tests, each once."""
    monkeypatch.setattr("tests.tiers.measured", lambda: {"b": 3.0})
    run: dict[str, list[str]] = {}
    for tier in ("quick", "slow", "all"):
        items: list[Any] = [SimpleNamespace(nodeid=name) for name in "abc"]
        hooks: Any = Hooks()
        Tiers(tier, writes=False).pytest_collection_modifyitems(hooks, items)
        run[tier] = [item.nodeid for item in items]
        assert len(items) + len(hooks.left) == 3
    assert run == {"quick": ["a", "c"], "slow": ["b"], "all": ["a", "b", "c"]}


def test_a_failed_test_keeps_its_tier() -> None:
    """Seconds of a test that failed aren't taken, neither up nor down."""
    before = {"slow, fails early": 9.0, "slow": 9.0, "gone": 9.0}
    now = {"slow, fails early": 0.1, "slow": LIMIT_S, "quick, hangs": 60.0, "quick": 0.1}
    kept = later(before, now, {"slow, fails early", "quick, hangs"})
    assert kept == {"slow, fails early": 9.0, "slow": LIMIT_S}


def test_slow_tests_are_there() -> None:
    """Each test whose seconds are kept is a function of its file."""
    functions: dict[str, set[str]] = {}
    missing = []
    for test in measured():
        file, _, rest = test.partition("::")
        if file not in functions:
            path = ROOT / file
            tree = ast.parse(path.read_text(encoding="utf-8") if path.exists() else "")
            named = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
            functions[file] = {node.name for node in named}
        if rest.rpartition("::")[2].partition("[")[0] not in functions[file]:
            missing.append(test)
    assert missing == [], f"run `make seconds`: {FILE.name} names tests that are gone"
