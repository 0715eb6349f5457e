"""Built-ins by walking a package, third parties by entry points."""

import itertools
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from gamekeeper import plugins

_NUMBER = itertools.count()


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on `sys.path` whose modules are forgotten afterwards."""
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) and str(tmp_path) in str(
            sys.modules[name].__file__
        ):
            del sys.modules[name]


def package(site: Path, **modules: str) -> str:
    """A package with modules of the given texts; gives its name."""
    name = f"shelf_{next(_NUMBER)}"
    (site / name).mkdir()
    (site / name / "__init__.py").write_text("")
    for module, text in modules.items():
        (site / name / f"{module}.py").write_text(text)
    return name


def distribution(site: Path, name: str, *entries: str, group: str = "gamekeeper.toys") -> None:
    """An installed distribution with entry points."""
    folder = site / f"{name}-1.2.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
    (folder / "entry_points.txt").write_text("\n".join([f"[{group}]", *entries]) + "\n")


def test_load_walks_built_ins_in_the_order_of_their_names(site: Path) -> None:
    """Every module is a plug-in under its name, those with an underscore in front are not."""
    shelf = package(site, b="WHO = 'b'", a="WHO = 'a'", _inner="raise RuntimeError")
    loaded = plugins.load("gamekeeper.toys", shelf)
    assert list(loaded.found) == ["a", "b"]
    assert [part.WHO for part in loaded.found.values()] == ["a", "b"]  # type: ignore[attr-defined]
    assert loaded.broken == ()


def test_load_adds_third_parties_after_the_built_ins(site: Path) -> None:
    """An entry point's object stands under the entry point's name."""
    shelf = package(site, z="")
    (site / "farm_toys.py").write_text("THING = 3\n")
    distribution(site, "farm_toys", "farm-thing = farm_toys:THING")
    loaded = plugins.load("gamekeeper.toys", shelf)
    assert list(loaded.found) == ["z", "farm-thing"]
    assert loaded.found["farm-thing"] == 3


def test_load_of_a_group_without_built_ins(site: Path) -> None:
    """Third parties' alone, where the built-ins register themselves."""
    (site / "lone_toys.py").write_text("THING = 4\n")
    distribution(site, "lone_toys", "lone-thing = lone_toys:THING")
    assert plugins.load("gamekeeper.toys").found == {"lone-thing": 4}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise ValueError('out of hay')", "ValueError: out of hay"),
        ("import nowhere_to_be_found", "nowhere_to_be_found"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("x = (", "SyntaxError"),
        (
            "class E(Exception):\n    def __str__(self): raise E\nraise E",
            "E: <exception str() failed>",
        ),
        ("OTHER = 1", "THING"),
    ],
)
def test_load_reports_a_broken_third_party_and_goes_on(site: Path, text: str, said: str) -> None:
    """What one distribution breaks is told with its name, and everybody else is there."""
    shelf = package(site, z="")
    module = f"broken_toys_{next(_NUMBER)}"
    (site / f"{module}.py").write_text(text)
    (site / "whole_toys.py").write_text("THING = 3\n")
    distribution(site, module, f"broken = {module}:THING")
    distribution(site, "whole_toys", "whole = whole_toys:THING")
    loaded = plugins.load("gamekeeper.toys", shelf)
    assert list(loaded.found) == ["z", "whole"]
    (broken,) = loaded.broken
    assert (broken.name, broken.group) == ("broken", "gamekeeper.toys")
    assert said in broken.error
    assert f"{module} 1.2" in str(broken)
    assert "Traceback" in broken.traceback


def test_load_keeps_a_built_in_name_for_the_built_in(site: Path) -> None:
    """A third party that takes the name of a built-in is left out, and told."""
    shelf = package(site, z="WHO = 'ours'")
    (site / "taker_toys.py").write_text("THING = 3\n")
    distribution(site, "taker_toys", "z = taker_toys:THING")
    loaded = plugins.load("gamekeeper.toys", shelf)
    assert loaded.found["z"].WHO == "ours"  # type: ignore[attr-defined]
    assert "taken" in loaded.broken[0].error


def test_load_sends_foreign_prints_to_stderr(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plug-in that greets on import doesn't spoil a JSON document on stdout."""
    shelf = package(site, z="")
    (site / "loud_toys.py").write_text("print('hello')\nTHING = 3\n")
    distribution(site, "loud_toys", "loud = loud_toys:THING")
    plugins.load("gamekeeper.toys", shelf)
    assert tuple(capsys.readouterr()) == ("", "hello\n")


def test_load_doesnt_hide_a_broken_built_in(site: Path) -> None:
    """An installation that lost a file of its own says so."""
    shelf = package(site, z="import nowhere_to_be_found")
    with pytest.raises(ImportError, match="nowhere_to_be_found"):
        plugins.load("gamekeeper.toys", shelf)


def test_load_lets_ctrl_c_through(site: Path) -> None:
    """Who interrupts while plug-ins load is not told about a broken plug-in instead."""
    shelf = package(site, z="")
    (site / "slow_toys.py").write_text("raise KeyboardInterrupt\n")
    distribution(site, "slow_toys", "slow = slow_toys:THING")
    with pytest.raises(KeyboardInterrupt):
        plugins.load("gamekeeper.toys", shelf)


def test_load_sees_what_is_installed_and_removed_meanwhile(site: Path) -> None:
    """What is read of installed distributions is kept only as long as nothing changes there."""
    (site / "late_toys.py").write_text("THING = 5\n")
    assert dict(plugins.load("gamekeeper.toys").found) == {}
    before = plugins.installed()
    distribution(site, "late_toys", "late = late_toys:THING")
    assert before != plugins.installed()
    assert dict(plugins.load("gamekeeper.toys").found) == {"late": 5}
    assert plugins.one("gamekeeper.toys", "late") == 5
    shutil.rmtree(site / "late_toys-1.2.dist-info")
    assert dict(plugins.load("gamekeeper.toys").found) == {}
    assert plugins.one("gamekeeper.toys", "late") is None


def test_load_doesnt_read_distributions_again(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening one environment after another reads everything installed once."""
    (site / "kept_toys.py").write_text("THING = 6\n")
    (site / "__pycache__").mkdir()  # made by the first import otherwise, which changes the place
    distribution(site, "kept_toys", "kept = kept_toys:THING")
    plugins.load("gamekeeper.toys")
    monkeypatch.setattr(plugins, "entry_points", lambda **which: pytest.fail("read again"))
    assert dict(plugins.load("gamekeeper.toys").found) == {"kept": 6}


def test_installed_copes_with_places_that_are_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A place of `sys.path` that doesn't exist stands for nothing, and comes into view later."""
    monkeypatch.setattr(sys, "path", ["/nowhere/at/all"])
    assert plugins.installed() == (("/nowhere/at/all", -1),)
