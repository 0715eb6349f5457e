"""One version, said in four places; the Pythons that are promised are those that tools aim at."""

import re
import tomllib

import gamekeeper
from tests.surface.sources import ROOT

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]


def said(name: str, pattern: str) -> list[str]:
    """What a file says where the pattern fits."""
    return re.findall(pattern, (ROOT / name).read_text(encoding="utf-8"), flags=re.M)


def test_version_is_the_same_everywhere() -> None:
    """Package, metadata, citation and changelog name one version."""
    assert PROJECT["version"] == gamekeeper.__version__
    assert said("CITATION.cff", r"^version: (.+)$") == [gamekeeper.__version__]
    assert said("CHANGELOG.md", r"^## \[([^]]+)\]")[0] == gamekeeper.__version__


def test_oldest_python_is_the_same_everywhere() -> None:
    """What is promised is what types and style are checked for."""
    oldest = PROJECT["requires-python"].removeprefix(">=")
    assert f"Programming Language :: Python :: {oldest}" in PROJECT["classifiers"]
    assert SETTINGS["tool"]["mypy"]["python_version"] == oldest
    assert SETTINGS["tool"]["ruff"]["target-version"] == f"py{oldest.replace('.', '')}"
