"""From what a user names to a live environment."""

from __future__ import annotations

import functools
import itertools
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pettingzoo
import pytest
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import SpecError
from gamekeeper.game.open import open_env, reopen
from gamekeeper.game.opened import Opened
from tests.game.toys import PARALLEL_TEXT, Alone, Pair, make_pair

Write = Callable[..., str]
_NUMBER = itertools.count()


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Write]:
    """Writes a file and gives its path; what it made Python import is forgotten afterwards."""
    before, path = set(sys.modules), sys.path[:]

    def write(text: str, name: str = "field.py") -> str:
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return str(file)

    yield write
    assert path == sys.path, "opening left something on sys.path"
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


@pytest.fixture
def register() -> Iterator[Callable[..., None]]:
    """Registers environments for one test."""
    saved = [(reg, dict(reg)) for reg in (pettingzoo.aec_registry, pettingzoo.parallel_registry)]
    yield pettingzoo.register
    for registry, before in saved:
        registry.clear()
        registry.update(before)


def told(spec: object, **kwargs: Any) -> str:
    """What the SpecError says that opening raises."""
    with pytest.raises(SpecError) as caught:
        open_env(spec, **kwargs)
    assert type(caught.value) is SpecError
    return str(caught.value)


# --- ids


@pytest.mark.parametrize("spec", ["sisl/pursuit-v5", "sisl/pursuit_v5", "sisl/pursuit"])
def test_open_env_reads_an_id_however_its_version_is_spelled(spec: str) -> None:
    """Both spellings of a version, and none, name one environment, as Parallel where it can be."""
    opened = open_env(spec)
    assert (opened.api, opened.spec) == ("parallel", "sisl/pursuit-v5")
    assert isinstance(opened.env, ParallelEnv)


def test_open_env_reads_the_api_in_front_of_an_id() -> None:
    """`aec:` asks for the AEC form of an id that both registries have, and the spec keeps it."""
    opened = open_env("aec:sisl/pursuit-v5")
    assert isinstance(opened.env, AECEnv)
    assert opened.spec == "aec:sisl/pursuit-v5"
    assert "aec" == open_env(opened.spec).api == open_env("sisl/pursuit-v5", api="aec").api


def test_open_env_opens_an_id_that_only_aec_has() -> None:
    """Without a wish the API is the one that there is."""
    opened = open_env("classic/tictactoe_v3")
    assert (opened.api, opened.spec) == ("aec", "classic/tictactoe-v3")


def test_open_env_refuses_to_convert_what_isnt_parallelizable() -> None:
    """A turn game isn't made into a tick game behind its author's back."""
    said = told("parallel:classic/tictactoe-v3")
    assert "tictactoe_v3 can't be opened as parallel" in said
    assert "is_parallelizable" in said


def test_open_env_names_what_comes_near_an_unknown_id() -> None:
    """A misspelled id and a version that isn't there get what is."""
    assert "'sisl/pursuit-v5'" in told("sisl/prusuit-v5")
    assert "there is sisl/pursuit-v5" in told("sisl/pursuit-v4")
    assert "sisl/pursuit-v5" in told("pursuit-v5")


def test_open_env_passes_on_where_pettingzoo_moved_a_group() -> None:
    """The old name of an MPE environment leads to what PettingZoo says about them."""
    assert "pip install mpe2" in told("mpe/simple_spread-v3")


def test_open_env_names_the_extra_of_a_missing_package(register: Callable[..., None]) -> None:
    """An environment whose package isn't installed says which line installs it."""
    hidden = {
        name: module for name, module in sys.modules.items() if name.startswith("pettingzoo.sisl")
    }
    for name in hidden:
        del sys.modules[name]
    blocked = sys.modules.get("pygame")
    sys.modules["pygame"] = None  # type: ignore[assignment]
    try:
        said = told("sisl/pursuit-v5")
    finally:
        del sys.modules["pygame"]
        if blocked is not None:
            sys.modules["pygame"] = blocked
        sys.modules.update(hidden)
    assert "pip install 'pettingzoo[sisl]'" in said
    assert "pygame" in said


def test_open_env_reads_a_short_name_as_ours_in_its_newest_version(
    register: Callable[..., None],
) -> None:
    """`meadow` is `gamekeeper/meadow-v10`, older versions are named in full."""
    for version in (2, 10, 9):
        register("parallel", f"gamekeeper/meadow-v{version}", make_pair)
    assert "gamekeeper/meadow-v10" == open_env("meadow").spec == open_env("gamekeeper/meadow").spec
    assert "gamekeeper/meadow-v9" == open_env("meadow-v9").spec == open_env("meadow_v9").spec


def test_open_env_reads_a_short_name_without_a_namespace(register: Callable[..., None]) -> None:
    """An id that somebody registered without a namespace is found by its name alone."""
    register("parallel", "Heath-v1", make_pair)
    assert "Heath-v1" == open_env("Heath").spec == open_env("Heath-v1").spec


def test_open_env_says_every_look_for_a_word_that_is_nothing() -> None:
    """A single word could be one of ours or a module; both looks are told."""
    said = told("nothing_of_this_name")
    assert "no environment is registered as gamekeeper/nothing_of_this_name" in said
    assert "there is no module nothing_of_this_name" in said


def test_open_env_gives_arguments_to_a_registered_factory(register: Callable[..., None]) -> None:
    """The registry's own arguments hold unless the user gives others."""
    register("parallel", "field/pair-v0", make_pair, kwargs={"n": 3})
    assert open_env("field/pair-v0").env.n == 3  # type: ignore[union-attr]
    assert open_env("field/pair-v0", n=4).env.n == 4  # type: ignore[union-attr]
    said = told("field/pair-v0", m=4)
    assert "'m'" in said
    assert "make_pair(*, n: int = 3)" in said.replace("'int'", "int")


# --- modules


def test_open_env_reads_a_module_with_and_without_a_factory() -> None:
    """PettingZoo's names are tried where no factory is named, by the API asked for."""
    assert open_env("mpe2.simple_spread_v3").spec == "mpe2.simple_spread_v3:parallel_env"
    assert open_env("aec:mpe2.simple_spread_v3").spec == "mpe2.simple_spread_v3:env"
    converted = open_env("aec:mpe2.simple_spread_v3:parallel_env")
    assert converted.spec == "aec:mpe2.simple_spread_v3:parallel_env"
    assert isinstance(converted.env, AECEnv)


def test_open_env_says_which_part_of_a_module_is_missing() -> None:
    """The missing part is named with what comes near it, never as a bare ImportError."""
    assert "'mpe2' has no module 'simple_sprad_v3'; the nearest" in told("mpe2.simple_sprad_v3:env")
    assert "no module 'mpe22' is installed" in told("mpe22.simple_spread_v3:env")
    assert "'simple_spread_v3'" in told("mpe2.simple_sprad_v3")
    assert "the nearest are 'parallel_env', 'raw_env'" in told("mpe2.simple_spread_v3:paralel_env")


def test_open_env_finds_modules_in_the_current_folder(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A console script lacks the current folder on its path; users expect it there all the same."""
    module = f"field_{next(_NUMBER)}"
    write(PARALLEL_TEXT, f"{module}.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    assert f"{module}:Pair" == open_env(module).spec


def test_open_env_tells_an_import_that_fails_inside_the_module(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module that is there but needs what isn't is told apart from one that isn't there."""
    module = f"field_{next(_NUMBER)}"
    write("import no_such_package.at_all\n", f"{module}.py")
    monkeypatch.chdir(tmp_path)
    said = told(f"{module}:make")
    assert f"importing {module} raised ModuleNotFoundError" in said
    assert "pip install no_such_package" in said
    assert f'{module}.py", line 1' in said
    assert "frozen importlib" not in said


# --- files


def test_open_env_reads_a_file_with_and_without_a_factory(write: Write) -> None:
    """The only environment class is found by itself."""
    path = write(PARALLEL_TEXT)
    named, found = open_env(f"{path}:Pair", n=3), open_env(Path(path), n=3)
    assert f"{path}:Pair" == named.spec == found.spec
    assert 3 == named.env.n == found.env.n  # type: ignore[union-attr]


def test_open_env_runs_a_script_and_sends_its_prints_to_stderr(
    write: Write, capfd: pytest.CaptureFixture[str]
) -> None:
    """A script that tries its environment out while it is imported opens all the same."""
    tail = "env = Pair()\nprint('hello', env.reset(seed=1)[0])\n"
    opened = open_env(write(PARALLEL_TEXT + tail))
    assert opened.spec.endswith(":Pair")
    out, err = capfd.readouterr()
    assert out == ""
    assert "hello" in err


def test_open_env_takes_an_instance_that_a_file_made(write: Write) -> None:
    """`file.py:env` is that one object: there is no second, and it takes no arguments."""
    path = write(PARALLEL_TEXT + "env = Pair(5)\n")
    opened = open_env(f"{path}:env")
    assert opened.env.n == 5  # type: ignore[union-attr]
    assert opened.make is None
    assert "takes no arguments" in told(f"{path}:env", n=3)


@pytest.mark.parametrize(
    ("tail", "api", "taken"),
    [
        ("def make(): return Pair()", None, "make"),
        ("def env(): return Pair()\ndef parallel_env(): return Pair()", None, "parallel_env"),
        ("def env(): return Pair()\ndef parallel_env(): return Pair()", "aec", "env"),
        ("from gymnasium import make", None, "Pair"),
        ("class Wide(Pair): pass", None, "Wide"),
        ("class _Inner(ParallelEnv): pass", None, "Pair"),
        ("from pettingzoo import AECEnv\nclass Turns(AECEnv): pass", "parallel", "Pair"),
    ],
)
def test_open_env_chooses_the_factory_that_is_meant(
    write: Write, tail: str, api: str | None, taken: str
) -> None:
    """The usual names go before classes; imported names and bases of others aren't meant."""
    opened = open_env(write(PARALLEL_TEXT + tail), api=api)
    assert opened.spec.endswith(f":{taken}")


def test_open_env_asks_where_a_file_leaves_a_choice(write: Write) -> None:
    """Two classes: both are named, in the form in which to type them."""
    path = write(PARALLEL_TEXT + "class Other(ParallelEnv): pass\n")
    said = told(path)
    assert f"{path}:Other" in said
    assert f"{path}:Pair" in said
    assert "has no environment" in told(write("def build(): ...", "empty.py"))


def test_open_env_loads_a_file_once_until_it_is_edited(write: Write) -> None:
    """The same text gives the same class; an edited file gives the class that stands in it now."""
    path = write(PARALLEL_TEXT)
    first, again = open_env(path), open_env(path)
    assert type(first.env) is type(again.env)
    write(PARALLEL_TEXT.replace("pair_v0", "pair_v1"))
    edited = open_env(path)
    assert edited.identity["name"] == "pair_v1"
    assert first.identity["source_digest"] != edited.identity["source_digest"]


def test_open_env_finds_modules_beside_a_file_also_while_it_builds(
    write: Write, tmp_path: Path
) -> None:
    """What a file imports from its folder is found when it is loaded and when it builds."""
    word = f"beside_{next(_NUMBER)}"
    write("WORD = 1\n", f"deep/{word}.py")
    write("WORD = 2\n", f"deep/{word}_later.py")
    make = f"def make():\n    import {word}_later\n    return Pair(2)\n"
    text = f"import {word}\n{PARALLEL_TEXT}\n{make}"
    opened = open_env(write(text, "deep/field.py"))
    assert opened.make is not None
    opened.make()
    assert not (tmp_path / "deep" / "__pycache__" / "field.cpython-311.pyc").exists()


def test_open_env_says_what_is_at_a_path_that_is_no_file(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that isn't there: the whole path, and what lies near it."""
    write(PARALLEL_TEXT, "two_robots.py")
    monkeypatch.chdir(tmp_path)
    assert "the nearest is 'two_robots.py'" in told("two_robot.py:make")
    assert f"there is no folder {tmp_path / 'nowhere'}" in told("nowhere/field.py")
    (tmp_path / "folder.py").mkdir()
    assert "seen: a folder" in told("folder.py:make")
    assert "there is no file" in told("a\0b.py:make")
    assert "there is no file" in told("x" * 5000 + ".py")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = (", "SyntaxError"),
        ("\x00", "raised"),
        ("raise ValueError('no grass')", "ValueError: no grass"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("def make(): raise ValueError('no grass')", "building"),
        ("import sys\ndef make(): sys.exit('bye')", "SystemExit: bye"),
        ("class Odd(BaseException): pass\ndef make(): raise Odd('hm')", "Odd: hm"),
        ("def make(): return make()", "RecursionError"),
        ("class E(Exception):\n def __str__(self): raise E\ndef make(): raise E", "E: <exception"),
    ],
)
def test_open_env_tells_what_foreign_code_raised(write: Write, text: str, said: str) -> None:
    """Whatever a file or a factory raises comes as one SpecError with its traceback as text."""
    path = write(text)
    message = told(path)
    assert said in message
    assert "field.py" in message
    assert len(message) < 8000


def test_open_env_keeps_the_cause_of_what_failed(write: Write) -> None:
    """A debugger still finds the original exception."""
    with pytest.raises(SpecError) as caught:
        open_env(write("def make(): raise LookupError('gone')"))
    assert isinstance(caught.value.__cause__, LookupError)


def test_open_env_lets_ctrl_c_through(write: Write) -> None:
    """An interrupt is an interrupt, not a broken environment."""
    path = write("def make(): raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        open_env(path)


@pytest.mark.parametrize(
    ("result", "said"),
    [
        ("None", "seen: None"),
        ("Pair", "the class Pair itself"),
        ("3", "builtins.int"),
        ("__import__('gymnasium').make('CartPole-v1')", "single-agent Gymnasium environment"),
        ("Loose()", "inherit from pettingzoo.AECEnv"),
    ],
)
def test_open_env_says_what_a_factory_returned_instead(
    write: Write, result: str, said: str
) -> None:
    """What is no PettingZoo environment is named by its type."""
    loose = "class Loose:\n    possible_agents = []\n    def step(self, a): ...\n"
    assert said in told(write(f"{PARALLEL_TEXT}{loose}def make(): return {result}\n"))


def test_open_env_refuses_an_async_factory(write: Write) -> None:
    """A coroutine is closed, so that no warning about it follows."""
    assert "can't be async" in told(write("async def make(): ..."))


# --- objects and factories


def test_open_env_takes_an_environment_object() -> None:
    """The object itself, with no way to a second one, and with a reason why no text opens it."""
    env = Pair()
    opened = open_env(env)
    assert env is opened.env
    assert opened.make is None
    assert opened.identity["kind"] == "object"
    assert isinstance(open_env(env, api="aec").env, AECEnv)
    with pytest.raises(SpecError, match="in memory"):
        reopen(opened.identity)


@pytest.mark.parametrize(
    ("factory", "kind"),
    [
        (Pair, "module"),
        (make_pair, "module"),
        (functools.partial(Pair, render_mode=None), "factory"),
        (lambda n=2: Pair(n), "factory"),
    ],
)
def test_open_env_takes_a_factory(factory: Callable[..., Any], kind: str) -> None:
    """What can be imported by its name can be opened by it again; a lambda can't."""
    opened = open_env(factory, n=3)
    assert opened.env.n == 3  # type: ignore[union-attr]
    assert kind == opened.identity["kind"]
    assert isinstance(opened.make and opened.make(), Pair)


def test_open_env_finds_no_second_environment_in_a_factory_that_has_one() -> None:
    """A factory that hands out one object again and again is found out at the second."""
    env = Pair()
    opened = open_env(lambda: env)
    assert opened.make is not None
    with pytest.raises(SpecError, match="the same environment again"):
        opened.make()


def test_opened_makes_instances_that_share_nothing() -> None:
    """Each instance gets its own copy of the arguments, in the API that was asked for."""
    names = ["x"]
    seen: list[Any] = []

    def factory(names: list[str]) -> Pair:
        seen.append(names)
        names.append("y")
        return Pair()

    opened = open_env(factory, api="aec", names=names)
    assert opened.make is not None
    assert isinstance(opened.make(), AECEnv)
    assert ["x"] == names == opened.identity["kwargs"]["names"]
    assert seen[0] is not seen[1]


@pytest.mark.parametrize(
    "nothing", [5, None, "", "a b", "a:b:c", "mpe2.simple_spread_v3:", b"x.py"]
)
def test_open_env_lists_its_forms_for_what_is_none_of_them(nothing: object) -> None:
    """What can't be read at all gets every form that can."""
    said = told(nothing)
    for form in ("module:factory", "path/to/file.py:factory", "butterfly/pistonball-v6"):
        assert form in said


def test_open_env_refuses_two_apis_and_unknown_ones() -> None:
    """A prefix and an argument that contradict each other aren't settled by guessing."""
    assert "two APIs" in told("aec:mpe2.simple_spread_v3", api="parallel")
    assert "no such API" in told("mpe2.simple_spread_v3", api="turns")


def test_open_env_says_which_arguments_dont_fit() -> None:
    """A refused argument comes with what the factory takes, also where it only passes them on."""
    said = told(Pair, m=3)
    assert "Pair(n: 'int' = 2, render_mode: 'str | None' = None)" in said
    said = told("mpe2.simple_spread_v3:parallel_env", M=3)
    assert "raw_env(N: 'int' = 3" in said


def test_open_env_cant_make_an_environment_parallel_that_doesnt_allow_it() -> None:
    """Nothing said is as good as no."""
    assert "alone_v0 can't be opened as parallel" in told(Alone, api="parallel")


# --- identity


def identity(opened: Opened) -> dict[str, Any]:
    """The identity as evidence keeps it."""
    return json.loads(json.dumps(opened.identity))


def test_identity_names_versions_of_what_an_environment_needs() -> None:
    """Python, the frameworks, the owning distribution, and what that requires for this group."""
    versions = identity(open_env("sisl/pursuit-v5"))["versions"]
    assert {"python", "numpy", "gymnasium", "pettingzoo", "pygame-ce", "scipy"} <= set(versions)
    assert "chess" not in versions
    assert {"mpe2", "scipy"} <= set(identity(open_env("mpe2.simple_spread_v3"))["versions"])


def test_identity_says_nothing_of_this_machine_but_the_path_of_a_file(write: Write) -> None:
    """Two people with the same file in two places have the same identity but for the path."""
    one = identity(open_env(write(PARALLEL_TEXT, "here/field.py"), n=3))
    two = identity(open_env(write(PARALLEL_TEXT, "there/field.py"), n=3))
    assert one.pop("path") != two.pop("path")
    assert one == two
    assert (
        one["kind"],
        one["entry_point"],
        one["name"],
        one["kwargs"],
    ) == ("file", "field.py:Pair", "pair_v0", {"n": 3})


def test_identity_has_one_digest_whatever_the_factory(write: Write) -> None:
    """The digest is of the files that define the environment, whatever stands around it."""
    path = write(PARALLEL_TEXT + "env = Pair()\ndef make(): return Pair()\n")
    digests = {
        identity(open_env(f"{path}:{name}"))["source_digest"] for name in ("env", "make", "Pair")
    }
    digests.add(identity(open_env(path, api="aec"))["source_digest"])
    assert len(digests) == 1


@pytest.mark.parametrize(
    "spec",
    ["aec:sisl/pursuit-v5", "mpe2.simple_spread_v3", "aec:mpe2.simple_spread_v3:parallel_env"],
)
def test_reopen_opens_the_same_environment_again(spec: str) -> None:
    """What evidence keeps of an environment is enough to open it with its arguments and its API."""
    opened = open_env(spec, max_cycles=7)
    again = reopen(identity(opened))
    assert (opened.spec, opened.api, opened.identity) == (again.spec, again.api, again.identity)


def test_reopen_keeps_arguments_that_arent_plain_json(write: Write) -> None:
    """Tuples stay tuples; an argument that is code can't come back, and is named."""
    path = write(PARALLEL_TEXT)
    assert reopen(identity(open_env(path, names=(1, 2)))).env.names == (1, 2)  # type: ignore[union-attr]
    with pytest.raises(SpecError, match="no text can build again"):
        reopen(identity(open_env(path, names=write)))


@pytest.mark.parametrize(
    "damage", [{}, {"entry_point": 3}, {"entry_point": "a.b:c", "api": "x"}, {"api": "aec"}]
)
def test_reopen_refuses_a_damaged_identity(damage: dict[str, Any]) -> None:
    """Evidence that lost its identity is told so."""
    with pytest.raises(SpecError, match="damaged"):
        reopen(damage)
