"""Snippets: values that can be pasted, programs that run."""

from __future__ import annotations

import operator
import subprocess
import sys
from enum import Enum
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.auditing.snippet import Home, home, snippet
from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.literal import literal
from gamekeeper.episodes.layout import agent_name
from gamekeeper.rollouts.episode_loop import EpisodePlan

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary(),
    lambda inner: st.lists(inner) | st.tuples(inner) | st.dictionaries(st.text(), inner),
)


@given(PLAIN)
def test_literal_reads_back(value: Any) -> None:
    """A plain value's text is an expression that gives it."""
    assert eval(literal(value), {"np": np}) == value


@pytest.mark.parametrize(
    "value",
    [
        np.array([0.1, -np.inf], np.float32),
        np.array([[1, 2]], np.int8),
        np.array([True]),
        np.zeros((0, 2)),
    ],
)
def test_literal_of_an_array_keeps_dtype_and_shape(value: Any) -> None:
    """Arrays come back with their dtype; 32-bit floats show no more digits than they have."""
    back = eval(literal(value), {"np": np})

    assert back.dtype == value.dtype
    assert np.array_equal(back.reshape(value.shape), value)
    assert "0.10000000149" not in literal(value)


def test_program_raises_where_its_proof_does() -> None:
    """Without a fault the program ends; with one it raises."""
    where = Home((), "None")
    quiet = snippet(
        where,
        "parallel",
        EpisodePlan(actions=()),
        Reproducer("assert True", plays=False),
        title="x",
        shows="y",
    )
    loud = snippet(
        where,
        "parallel",
        EpisodePlan(actions=()),
        Reproducer("assert False", plays=False),
        title="x",
        shows="y",
    )

    exec(quiet, {})
    with pytest.raises(AssertionError):
        exec(loud, {})


class Color(Enum):
    """An agent that `repr` gives no form that can be pasted."""

    RED = 1
    BLUE = 2


@pytest.mark.parametrize("agents", [tuple(Color), (("a", Color.RED), ("a", Color.BLUE))])
def test_program_plays_with_agents_of_the_environment(agents: tuple[Any, ...]) -> None:
    """It finds them by their text, also where its last lines name one."""
    name = agent_name(agents[1])
    find = f"agent = next(a for a in ACTIONS[0] if str(a) == {name!r})"
    text = snippet(
        Home((), "build()"),
        "parallel",
        EpisodePlan(actions=[{agents[1]: 3, agents[0]: 0}]),
        Reproducer(find, plays=False),
        title="x",
        shows="y",
    )
    names: dict[str, Any] = {"build": lambda: SimpleNamespace(possible_agents=agents)}
    exec(text, names)
    assert names["ACTIONS"] == [{agents[1]: 3, agents[0]: 0}]
    assert all(map(operator.is_, names["ACTIONS"][0], reversed(agents)))
    assert names["agent"] is agents[1]


def test_agent_that_an_environment_does_not_know_ends_the_program() -> None:
    """A name is missing then, which shows nothing of the environment."""
    play = EpisodePlan(actions=[{Color.RED: 3}])
    text = snippet(Home((), "build()"), "parallel", play, None, title="x", shows="y")
    with pytest.raises(NameError, match="RED"):
        exec(text, {"build": lambda: SimpleNamespace(possible_agents=[Color.BLUE])})


def test_home_needs_pettingzoo_alone_where_it_can() -> None:
    """A module is imported by itself; an id goes through gk.make, an object can't be built."""
    module = {"kind": "module", "entry_point": "mpe2.simple_spread_v3:parallel_env"}
    assert home("mpe2.simple_spread_v3:parallel_env", module, {"N": 2}) == Home(
        ("from mpe2.simple_spread_v3 import parallel_env as build",), "build(N=2)"
    )
    shipped = {"kind": "id", "entry_point": "classic/go-v5", "api": "aec"}
    assert home("classic/go-v5", shipped, {}).make == "pettingzoo.make('aec', 'classic/go-v5')"
    assert "gk.make('warehouse'" in home("warehouse", {"kind": "id"}, {}).make
    assert home("<object>", {"kind": "object"}, {}).make == ""


def test_program_finds_a_module_of_the_current_folder_from_any_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A script's path begins with its own folder, and lacks the one that it was started in."""
    (tmp_path / "a farm").mkdir()
    (tmp_path / "a farm" / "barn_of_snippets.py").write_text("def make():\n    return 'a barn'\n")
    monkeypatch.chdir(tmp_path / "a farm")
    found = home("x", {"kind": "module", "entry_point": "barn_of_snippets:make"}, {})
    text = snippet(found, "parallel", EpisodePlan(actions=[]), None, title="x", shows="y")
    program = tmp_path / "program.py"
    program.write_text(text.replace("env = make()", "print(make())").partition("observations")[0])
    command = [sys.executable, "-I", str(program)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "a barn\n"
