"""What evidence from elsewhere may have opened unasked, and third parties' openers."""

import itertools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pettingzoo
import pytest

from gamekeeper.errors import PolicyError, SpecError
from gamekeeper.interface.opening import distrust, open_env
from gamekeeper.interface.policy import distrust_policy, resolve
from tests.interface.toys import PARALLEL_TEXT, Pair

Install = Callable[..., str]
_NUMBER = itertools.count()
_FACTORIES = "\ndef parallel_env(**kwargs):\n    return Pair(**kwargs)\n"


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installs a distribution with one module into a folder on `sys.path`; gives its name."""
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))
    before = set(sys.modules)

    def install(
        text: str = PARALLEL_TEXT + _FACTORIES,
        requires: str = "pettingzoo>=1.24",
        editable: Path | None = None,
        entry: str = "",
    ) -> str:
        name = f"pasture_{next(_NUMBER)}"
        info = site / f"{name}-1.2.dist-info"
        info.mkdir()
        needs = f"Requires-Dist: {requires}\n" if requires else ""
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n{needs}"
        )
        (info / "top_level.txt").write_text(name)
        (info / "entry_points.txt").write_text(entry.format(module=name))
        record = f"{name}-1.2.dist-info/METADATA,,\n"
        if editable is None:
            (site / f"{name}.py").write_text(text)
            record += f"{name}.py,,\n"
        else:
            editable.mkdir(exist_ok=True)
            (editable / f"{name}.py").write_text(text)
            (info / "direct_url.json").write_text(
                f'{{"url": "{editable.as_uri()}", "dir_info": {{"editable": true}}}}'
            )
        (info / "RECORD").write_text(record)
        return name

    yield install
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def identity(entry_point: str, **fields: Any) -> dict[str, Any]:
    """An identity as a manifest could hold it."""
    return {"kind": "module", "entry_point": entry_point, "api": "parallel", "kwargs": {}} | fields


@pytest.mark.parametrize("spec", ["sisl/pursuit-v5", "aec:mpe2.simple_spread_v3"])
def test_distrust_has_nothing_against_installed_environments(spec: str) -> None:
    """A registered id and PettingZoo's factory names in an installed package open unasked."""
    assert distrust(open_env(spec).identity) is None


def test_distrust_trusts_a_factory_name_without_importing(install: Install) -> None:
    """That `parallel_env` may be opened is known before a line of its module has run."""
    module = install("raise RuntimeError\n")
    assert distrust(identity(f"{module}:parallel_env")) is None
    assert module not in sys.modules


def test_distrust_trusts_a_class_of_environments(install: Install) -> None:
    """Under another name only a class derived from PettingZoo's is taken."""
    module = install()
    assert distrust(identity(f"{module}:Pair")) is None
    assert "neither called" in str(distrust(identity(f"{module}:Discrete")))
    assert "neither called" in str(distrust(identity(f"{module}:nothing")))


def test_distrust_counts_an_editable_installation(install: Install, tmp_path: Path) -> None:
    """A project under development is installed as well, where its folder is what Python finds."""
    project = tmp_path / "project"
    module = install(editable=project)
    assert "no installed distribution" in str(distrust(identity(f"{module}:parallel_env")))
    sys.path.append(str(project))
    try:
        assert distrust(identity(f"{module}:parallel_env")) is None
    finally:
        sys.path.remove(str(project))


def test_distrust_isnt_fooled_by_a_namesake_before_the_installed_module(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file in the current folder with the name of an installed module is not that module."""
    module = install()
    (tmp_path / f"{module}.py").write_text("raise RuntimeError\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "no installed distribution" in str(distrust(identity(f"{module}:parallel_env")))


def test_distrust_takes_nothing_in_the_current_folder_for_installed(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of evidence that holds a module and its metadata beside it vouches for nothing."""
    module = install()
    assert distrust(identity(f"{module}:parallel_env")) is None
    monkeypatch.chdir(tmp_path / "site")
    assert "no installed distribution" in str(distrust(identity(f"{module}:parallel_env")))


def test_distrust_asks_for_a_requirement_on_pettingzoo(install: Install) -> None:
    """Any package may have something called `env`; one of environments requires PettingZoo."""
    for requires in ("", "pettingzoo-nonesuch", "requests"):
        module = install(requires=requires)
        assert "doesn't require pettingzoo" in str(distrust(identity(f"{module}:env")))


@pytest.mark.parametrize(
    "entry_point",
    [
        "os:system",
        "os:env",
        "subprocess:run",
        "builtins:exec",
        "this",
        "nonesuch_package:parallel_env",
        "pip:env",
        "numpy:env",
        "pettingzoo.__main__:env",
        "pettingzoo.utils:nothing.env",
        "mpe2.simple_spread_v3",
        "/srv/field.py:parallel_env",
        "field.py:parallel_env",
        "aec:os:system",
        "a b",
        "",
        "x" * 100_000,
    ],
)
def test_distrust_gives_a_reason_for_everything_else(entry_point: str) -> None:
    """Nothing that a hostile manifest could name is opened, whatever kind it claims to be."""
    loaded = set(sys.modules)
    for kind in ("module", "id", "file", "factory", "object", ""):
        assert distrust(identity(entry_point, kind=kind, path="/srv/other.py"))
    assert not {"this", "antigravity"} & (set(sys.modules) - loaded)


@pytest.mark.parametrize(
    "damage",
    [
        {"api": "os:"},
        {"api": None},
        {"api": ["aec"]},
        {"entry_point": None},
        {"entry_point": ["a"]},
        {"kind": ["module"]},
        {"kind": None},
    ],
)
def test_distrust_gives_a_reason_for_a_damaged_identity(damage: dict[str, Any]) -> None:
    """An identity of the wrong types is told, not followed."""
    assert "damaged" in str(distrust(identity("mpe2.simple_spread_v3:env") | damage))
    assert "damaged" in str(distrust(["mpe2"]))  # type: ignore[arg-type]


def test_distrust_gives_a_reason_for_files_and_objects(tmp_path: Path) -> None:
    """A file is code that only its owner can vouch for; an object isn't there any more."""
    file = tmp_path / "field.py"
    file.write_text(PARALLEL_TEXT)
    assert "outside the installed packages" in str(distrust(open_env(file).identity))
    assert "no installed distribution" in str(distrust(open_env(Pair()).identity))
    assert "in memory" in str(distrust(open_env(lambda: Pair()).identity))


def test_distrust_policy_lets_only_bare_words_through() -> None:
    """Whoever reruns policies from evidence is asked before code that it names is run."""
    words = ("random", "first-legal", "noop", "reference")
    assert [distrust_policy(name) for name in words] == [None] * 4
    for name in ("os:system", "field.py:act", "random:", ":", "C:\\field.py:act"):
        assert "code" in str(distrust_policy(name))


@pytest.mark.parametrize("word", ["os", "field.py", "os.system", "./field.py", "", "../field"])
def test_bare_word_never_loads_code(
    word: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is let through unasked is looked up among policies, never among modules or files."""
    (tmp_path / "field.py").write_text("raise SystemExit('was run')")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PolicyError, match="no policy called"):
        resolve(word)


OPENER = """
from gamekeeper.interface.env_source import NotHereError, Source
from tests.interface.toys import Pair

SYNTAX = "barn:NAME"

def matches(spec):
    return isinstance(spec, str) and spec.startswith("barn:")

def locate(spec, api):
    if spec == "barn:empty":
        raise NotHereError("the barn is empty", seen="straw")
    return Source(kind="barn", factory=Pair, spec=spec, entry_point=spec)
"""


def test_open_env_asks_third_parties_openers(install: Install) -> None:
    """A new way of naming environments is one object behind an entry point."""
    install(OPENER, entry="[gamekeeper.openers]\nbarn = {module}\n")
    opened = open_env("barn:pair", n=3)
    assert (opened.spec, opened.identity["kind"]) == ("barn:pair", "barn")
    assert opened.env.n == 3  # type: ignore[union-attr]
    assert "vouches for nothing" in str(distrust(opened.identity))
    with pytest.raises(SpecError, match="straw"):
        open_env("barn:empty")
    with pytest.raises(SpecError, match="barn:NAME"):
        open_env("a b")


def test_task_of_an_installed_package_opens_by_its_name(install: Install) -> None:
    """Its entry point is what registers it; `gamekeeper new` writes one."""
    register = "import pettingzoo\npettingzoo.register('parallel', 'grazing-v0', Pair)\n"
    install(PARALLEL_TEXT + register, entry="[gamekeeper.tasks]\ngrazing = {module}\n")
    assert open_env("grazing").spec == "grazing-v0"
    del pettingzoo.parallel_registry["grazing-v0"]


def test_open_env_isnt_stopped_by_an_opener_that_fails(install: Install) -> None:
    """An opener that raises on every text hides no environment, and vouches for none."""
    install(
        "SYNTAX = 'x'\ndef matches(spec): raise ValueError('confused')\nlocate = matches\n",
        entry="[gamekeeper.openers]\nconfused = {module}\n",
    )
    assert open_env("mpe2.simple_spread_v3").api == "parallel"
    with pytest.raises(SpecError, match="ValueError: confused"):
        open_env("mpe2.simple_sprad_v3")
    assert "confused" in str(distrust(identity("mpe2.simple_spread_v3:env")))


def test_open_env_tells_of_openers_that_are_left_out(install: Install) -> None:
    """Who wonders why a form isn't known reads that its opener is broken."""
    install("raise ValueError('burnt down')", entry="[gamekeeper.openers]\nbarn = {module}\n")
    install("SYNTAX = 'hay:NAME'\n", entry="[gamekeeper.openers]\nhay = {module}\n")
    with pytest.raises(SpecError, match="burnt down") as caught:
        open_env("a b")
    assert "hay is left out" in str(caught.value)
    assert isinstance(open_env(Pair).env, Pair)
