"""From a Python file to a live environment, and what is told when its code fails."""

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

from gamekeeper.errors import SpecError
from gamekeeper.interface.opening import open_env
from tests.interface.toys import PARALLEL_TEXT, told

Write = Callable[..., str]
_NUMBER = itertools.count()


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
    assert "takes no keyword arguments" in told(f"{path}:env", n=3)


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
    assert "actual: a folder" in told("folder.py:make")
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
        ("None", "actual: None"),
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
