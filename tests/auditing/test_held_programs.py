"""Programs with causes held still: no text twice, nothing that nobody names, the simplest hold."""

from typing import Any

import pytest

from gamekeeper.auditing.causes import GLOBALS, RESETS, SPACES
from gamekeeper.auditing.confirm import Programs, _finding
from gamekeeper.auditing.held_programs import after_make, has_own_calls, held_still, pruned
from gamekeeper.checks.verdict import Finding, Reproduced

PROGRAM = """# a check
from tests.auditing.test_held_programs import Draws as build
import numpy as np

def make():
    return build()

SEED = 1

env = make()
env.reset(seed=SEED)
first = env.drawn
env.reset(seed=SEED)
assert first == env.drawn, (first, env.drawn)
"""


class Draws:
    """Draws from the global generator, whatever its seed is."""

    possible_agents = ()

    def reset(self, seed: int | None = None) -> None:
        """Draws."""
        self.drawn = __import__("numpy").random.random()

    def step(self, action: Any) -> None:
        """Does nothing."""


class OwnCalls(Draws):
    """Its calls are attributes of the instance."""

    def __init__(self) -> None:
        self.reset = super().reset  # type: ignore[method-assign]  # what is looked at


def test_program_passes_once_its_cause_is_held_still() -> None:
    """It differs as it is, and not with the generators seeded before each reset."""
    with pytest.raises(AssertionError):
        exec(PROGRAM, {})
    exec(held_still(PROGRAM, RESETS), {})


def test_text_that_two_holds_share_stands_once() -> None:
    """Each function and each import, also of what the environment itself needs."""
    program = held_still(held_still(PROGRAM, GLOBALS), SPACES)
    exec(program, {})
    lines = [each for each in program.splitlines() if each.startswith(("def ", "import "))]
    assert "def with_class(env, **methods):" in lines
    assert len(lines) == len(set(lines))


@pytest.mark.parametrize("is_own", [False, True])
def test_own_calls_are_put_in_a_class_only_where_instances_have_them(is_own: bool) -> None:
    """Elsewhere the program is shorter by that."""
    assert has_own_calls(OwnCalls() if is_own else Draws()) == is_own
    program = PROGRAM.replace("Draws", "OwnCalls" if is_own else "Draws")
    held = held_still(program, RESETS, has_own_calls=is_own)
    assert ("def calls_of_class(make):" in held) == is_own
    exec(held, {})


def test_program_that_builds_nothing_or_is_not_python_stays() -> None:
    """There is nothing to hold."""
    for program in ("assert False\n", "def make(:\n"):
        assert held_still(program, RESETS) == program
        assert after_make(program) == ("", program)


def test_what_a_program_does_not_name_is_left_out() -> None:
    """Functions of which nothing is left that calls them, too; what acts stays."""
    program = PROGRAM.replace(
        "SEED = 1\n", "SEED = 1\nACTIONS = [\n    0,\n]\n\n\ndef a():\n    b()\n"
    )
    assert pruned(program.replace("import numpy as np\n", "import numpy as np\nimport re\n")) == (
        PROGRAM.replace("import numpy as np\n", "")
    )
    assert "def make():" in pruned(PROGRAM.partition("env =")[0])
    assert pruned("...  # your environment )\n") == "...  # your environment )\n"


@pytest.mark.parametrize(
    ("showing", "expected"),
    [
        (("draws_seeded", "resets_held", "globals_held"), "draws_seeded"),
        (("resets_held", "globals_held"), "resets_held"),
        (("globals_held",), "globals_held"),
    ],
)
def test_simplest_hold_that_shows_a_finding_is_given_out(
    showing: tuple[str, ...], expected: str
) -> None:
    """The heavier one says that it can be shown; a simpler one takes its place where it does."""

    class Work:
        def finding(self, each: Programs) -> tuple[Finding, Reproduced, bool]:
            is_shown = any(f"make = {name}(" in each.finding.reproducer for name in showing)
            return each.finding, Reproduced(5, 5, None), is_shown

    finding = Finding("here", "one", "other", "fix", PROGRAM)
    programs = Programs(finding, (PROGRAM,), compares=True, unchanged="")
    given, _, is_shown = _finding(programs, (), Work())  # type: ignore[arg-type]  # a stub
    assert is_shown
    assert f"make = {expected}(make)\n" in given.reproducer
