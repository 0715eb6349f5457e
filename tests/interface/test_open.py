"""From an id, a module, a factory or an object to a live environment."""

import functools
import itertools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.errors import SpecError
from gamekeeper.interface.opening import open_env, reopen
from tests.interface.toys import PARALLEL_TEXT, Alone, Pair, make_pair, told

Write = Callable[..., str]
_NUMBER = itertools.count()


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
    assert "did you mean sisl/pursuit-v5?" in told("sisl/prusuit-v5")
    assert "did you mean sisl/pursuit-v5" in told("sisl/pursuit-v4")
    assert "did you mean sisl/multiwalker-v9?" in told("multiwalker-v9")
    assert "did you mean sisl/pursuit-v5 or pursuit-v0?" in told("pursuit-v5")
    assert "did you mean warehouse-v0?" in told("warehous")
    assert "did you mean mpe2.simple_spread_v3:parallel_env?" in told("mpe2/simple_spread_v3")
    assert "did you mean mpe2.simple_spread_v3:parallel_env?" in told("mpe2.simple_spread")


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
    assert "the nearest is 'parallel_env'" in told("mpe2.simple_spread_v3:paralel_env")


def test_open_env_finds_modules_in_the_current_folder(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A console script lacks the current folder on its path; users expect it there all the same."""
    module = f"field_{next(_NUMBER)}"
    write(PARALLEL_TEXT, f"{module}.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    assert f"{module}:Pair" == open_env(module).spec


@pytest.mark.parametrize(
    "front",
    [
        "from offering.deep.inner import games_v1",
        "def __getattr__(name):\n    if name != 'games_v1': raise AttributeError(name)\n"
        "    from offering.deep.inner import games_v1\n    return games_v1",
    ],
)
def test_open_env_takes_a_module_that_a_package_offers(
    front: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module may lie deeper than its documented name says, or load when it is asked for."""
    inner = tmp_path / "offering" / "deep" / "inner"
    inner.mkdir(parents=True)
    (tmp_path / "offering" / "__init__.py").write_text(front + "\n")
    (inner / "games_v1.py").write_text(
        "from tests.interface.toys import make_pair as parallel_env\n"
    )
    monkeypatch.setitem(sys.modules, "offering", None)
    monkeypatch.delitem(sys.modules, "offering")
    monkeypatch.syspath_prepend(str(tmp_path))
    for spec in (
        "offering.games_v1:parallel_env",
        "offering.games_v1",
        "offering:games_v1.parallel_env",
    ):
        assert isinstance(open_env(spec).env, Pair)
    with pytest.raises(SpecError, match=r"there is no module offering\.games_v2"):
        open_env("offering.games_v2:parallel_env")
    for name in [each for each in sys.modules if each.partition(".")[0] == "offering"]:
        del sys.modules[name]


NEEDY = """
from tests.interface.toys import Pair

class parallel_env(Pair):
    def __init__(self, scenario, agent_conf, render_mode=None):
        super().__init__(int(agent_conf))

def make(scenario, *, agent_conf): return parallel_env(scenario, agent_conf)
def env(**kwargs): return parallel_env(**kwargs)
def broken(**kwargs): return make(**kwargs, agent_conf=len())
"""


@pytest.mark.parametrize("name", ["parallel_env", "make", "env"])
def test_open_env_names_the_arguments_that_must_be_given(
    name: str, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a class, a function and a factory that passes all on; with them the environment opens."""
    module = f"needy_{next(_NUMBER)}"
    write(NEEDY, f"{module}.py")
    monkeypatch.chdir(tmp_path)
    for spec in (f"{module}:{name}", f"{module}.py:{name}"):
        said = told(spec)
        assert "'scenario', 'agent_conf' must be given" in said
        assert """--kwargs '{"scenario": ..., "agent_conf": ...}'""" in said
        assert "gk.make(..., scenario=..., agent_conf=...)" in said
        assert "Traceback" not in said
        assert open_env(spec, scenario="Ant", agent_conf="3").env.n == 3  # type: ignore[union-attr]
        with pytest.raises(SpecError, match="'agent_conf' must be given") as raised:
            open_env(spec, scenario="Ant")
        assert "'scenario' must" not in str(raised.value)
    assert "len()" in told(f"{module}:broken")


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


def test_open_env_of_a_file_that_imports_its_package_names_the_module(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lies in the current folder isn't offered for installation."""
    package = f"farm_{next(_NUMBER)}"
    write("", f"{package}/__init__.py")
    write(f"from {package} import rules\n", f"{package}/env.py")
    monkeypatch.chdir(tmp_path)
    said = told(f"{package}/env.py:make")
    assert f"by its module, {package}.env:NAME" in said
    assert "pip install" not in said


def test_open_env_of_a_file_that_imports_from_a_folder_above_says_where_to_start(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module that lies above the file's folder isn't offered for installation either."""
    number = next(_NUMBER)
    write("", f"farm/barn_{number}.py")
    write(f"import barn_{number}\n", f"farm/envs/env_{number}.py")
    monkeypatch.chdir(tmp_path)
    said = told(f"farm/envs/env_{number}.py:make")
    assert f"'barn_{number}' is in {tmp_path / 'farm'}" in said
    assert f"start there, and name the environment by its module, envs.env_{number}:NAME" in said
    assert "pip install" not in said


def test_open_env_of_a_dot_in_place_of_a_colon_names_what_is_meant(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A function of a module is no module, and is offered as what it is."""
    module = f"field_{next(_NUMBER)}"
    write("def make(): ...\n", f"{module}.py")
    monkeypatch.chdir(tmp_path)
    assert f"did you mean {module}:make?" in told(f"{module}.make")


def test_open_env_takes_an_environment_object() -> None:
    """The object itself; its class is named for another process, or what to add is."""
    env = Pair()
    opened = open_env(env)
    assert env is opened.env
    assert opened.make is None
    assert opened.identity["entry_point"] == f"{Pair.__module__}:Pair"
    assert isinstance(open_env(env, api="aec").env, AECEnv)
    assert type(reopen(opened.identity).env) is Pair

    class Local(Pair):
        """A class that no name finds."""

    lost = open_env(Local()).identity
    assert lost["kind"] == "object"
    with pytest.raises(SpecError, match="in memory"):
        reopen(lost)


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
    assert "Pair(n: int = 2, render_mode: str | None = None)" in said
    said = told("mpe2.simple_spread_v3:parallel_env", M=3)
    assert "raw_env(N: 'int' = 3" in said


def test_open_env_cant_make_an_environment_parallel_that_doesnt_allow_it() -> None:
    """Nothing said is as good as no."""
    assert "alone_v0 can't be opened as parallel" in told(Alone, api="parallel")
