"""Policies by what a user names."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from gymnasium import spaces
from numpy.random import Generator

from gamekeeper import plugins
from gamekeeper.errors import ActionError, PolicyError
from gamekeeper.interface.joint_policy import assign
from gamekeeper.interface.policy import Chosen, parse_choices, resolve


def steady(observation: Any, agent: Any, info: Any, rng: Generator) -> int:
    """A policy that can be imported by its name."""
    return 1


class Counting:
    """A policy with a state and a version."""

    version = "2026-11"

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Generator) -> int:
        self.calls += 1
        return self.calls


def told(choice: Any) -> str:
    """What the PolicyError says that resolving raises."""
    with pytest.raises(PolicyError) as caught:
        resolve(choice)
    return str(caught.value)


@pytest.mark.parametrize("name", ["random", "first-legal", "noop", " random "])
def test_resolve_finds_the_built_ins(name: str) -> None:
    """A built-in goes by its word and has a version of its own."""
    chosen = resolve(name)
    assert chosen.name == name.strip()
    assert chosen.version == "1"


def test_resolve_finds_a_callable_in_a_module() -> None:
    """`module:callable`, whose version is the digest of its source."""
    chosen = resolve("tests.interface.test_policy:steady")
    assert chosen.policy(None, "a", {}, None) == 1  # type: ignore[operator,arg-type]
    assert chosen.name == "tests.interface.test_policy:steady"
    assert chosen.version
    assert len(chosen.version) == 32


def test_resolve_finds_a_callable_in_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`file.py:callable`, also deep in an object; what the file prints goes to stderr."""
    text = "print('hi')\nclass Box:\n    @staticmethod\n    def act(o, a, i, r): return 3\n"
    file = tmp_path / "acts.py"
    file.write_text(text)
    before = set(sys.modules)
    chosen = resolve(f"{file}:Box.act")
    assert chosen.policy(None, "a", {}, None) == 3  # type: ignore[operator,arg-type]
    digest = chosen.version
    file.write_text(text.replace("3", "4"))
    assert resolve(f"{file}:Box.act").version != digest
    assert capsys.readouterr().out == ""
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_resolve_takes_callables_and_makes_one_instance_of_a_class() -> None:
    """A function is taken as it is; a class becomes one policy, a declared version is kept."""
    assert resolve(steady).policy is steady
    assert resolve(steady).name.endswith("test_policy:steady")
    chosen = resolve(Counting)
    assert isinstance(chosen.policy, Counting)
    assert chosen.version == "2026-11"
    assert resolve(chosen) is chosen


def test_resolve_takes_further_schemes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A trainer's adapter adds a word of its own in front of a colon."""
    seen: list[str] = []

    def load(path: str) -> Callable[..., Any]:
        seen.append(path)
        return steady

    monkeypatch.setattr(plugins, "one", lambda group, word: {"sb3": load}.get(word))
    chosen = resolve("sb3:model:1.zip")
    assert isinstance(chosen, Chosen)
    assert (chosen.name, seen) == ("sb3:model:1.zip", ["model:1.zip"])


def test_resolve_names_what_comes_near_an_unknown_word() -> None:
    """A misspelled built-in gets the right one, and every form there is."""
    said = told("randon")
    assert "did you mean random?" in said
    assert "module:callable" in said
    assert "there is no policy called ''" in told("")


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ("tests.interface.test_policy:stead", "the nearest is 'steady'"),
        ("tests.interface.no_such:act", "there is no module tests.interface.no_such"),
        ("nowhere/acts.py:act", "there is no file nowhere/acts.py"),
        ("acts.py", "module:callable"),
        ("acts.py:", "module:callable"),
        ("tests.interface.test_policy:told", "(observation, agent, info, rng)"),
        ("sys:path", "can't be called"),
        ("sys:", "module:callable"),
        (5, "can't be called"),
        (None, "can't be called"),
        (lambda agent, observation, info: 0, "in this order"),
        (type("NeedsMore", (), {"__init__": lambda self, x: None}), "missing 1 required"),
    ],
)
def test_resolve_says_why_a_policy_cant_be_had(choice: Any, said: str) -> None:
    """What can't be found, loaded or called is a PolicyError, whatever was wrong."""
    assert said in told(choice)


def test_resolve_tells_what_loading_raised(tmp_path: Path) -> None:
    """A file that fails to load says so with its traceback."""
    file = tmp_path / "acts.py"
    file.write_text("raise ValueError('no paint')\n")
    said = told(f"{file}:act")
    assert "ValueError: no paint" in said
    assert 'acts.py", line 1' in said


def test_parse_choices_reads_the_command_line() -> None:
    """`[AGENT|ROLE=]X`: the first sign of equality counts, unless it stands in a path."""
    texts = ["picker=random", "carrier_0=m:act", "noop"]
    assert parse_choices(texts) == {"picker": "random", "carrier_0": "m:act", "*": "noop"}
    assert parse_choices(["runs/a=b.py:act"]) == {"*": "runs/a=b.py:act"}
    assert parse_choices(["a=runs/a=b.py:act"]) == {"a": "runs/a=b.py:act"}
    assert parse_choices([]) == {}


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["picker="], "incomplete"),
        (["=random"], "incomplete"),
        ([""], "incomplete"),
        (["a=noop", "a=random"], "two policies for a"),
        (["noop", "random"], "two policies for everyone"),
    ],
)
def test_parse_choices_refuses_what_is_half_said_or_said_twice(texts: list[str], said: str) -> None:
    """The user is asked rather than guessed at."""
    with pytest.raises(PolicyError, match=said):
        parse_choices(texts)


@pytest.mark.parametrize(
    ("space", "info", "legal"),
    [
        (spaces.Discrete(3, start=4), {}, "an action of Discrete(3, start=4): 4 to 6"),
        (
            spaces.Discrete(3),
            {"action_mask": [1, 0, 1]},
            "an action that is legal by the mask: 0, 2",
        ),
        (spaces.Discrete(3), {"action_mask": [1]}, "an action of Discrete(3): 0 to 2"),
        (
            spaces.Discrete(30),
            {"action_mask": [1] * 30},
            f"an action that is legal by the mask: {', '.join(map(str, range(20)))} and 10 more",
        ),
    ],
)
def test_illegal_action_is_refused_with_those_that_were_legal(
    space: spaces.Discrete, info: dict[str, Any], legal: str
) -> None:
    """By the mask where there is one, else by the space."""
    policies = assign(
        lambda observation, agent, info, rng: 99,
        possible_agents=["a"],
        action_space=lambda agent: space,
    )
    policies.begin(0, 0)
    with pytest.raises(ActionError) as caught:
        policies.act("a", None, info)
    assert caught.value.expected == legal
