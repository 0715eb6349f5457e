"""Programs with causes held still: what a hold adds to a reproducer, and where."""

import ast
import random
import re
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.causes import GLOBALS, RESETS
from gamekeeper.auditing.holds import Hold, calls_of_class, with_class
from gamekeeper.checks.reproducer_source import texts_of

MAKE: Final = "\ndef make():\n"
"""The line before which a reproducer's imports stand."""
CALLS: Final = ("reset", "step", "observe", "state", "render")
"""Calls that a hold replaces."""


def has_own_calls(env: Any) -> bool:
    """Tells whether an instance has calls as attributes, which hide those of its class."""
    return any(name in getattr(env, "__dict__", ()) for name in CALLS)


def after_make(program: str) -> tuple[str, str]:
    """The program up to what it last calls `make` or `plain`, and the rest of it.

    The rest is all of it where it isn't Python, or builds nothing.
    """
    try:
        nodes = ast.parse(program).body
    except SyntaxError:
        return "", program
    ends = [each.end_lineno or 0 for each in nodes if {"make", "plain"} & {*_bound(each)}]
    lines = program.splitlines(keepends=True)
    count = max(ends, default=0)
    return "".join(lines[:count]), "".join(lines[count:])


def _bound(node: ast.stmt) -> Iterator[str]:
    """Names that a statement gives a value."""
    if isinstance(node, ast.FunctionDef):
        yield node.name
    for target in node.targets if isinstance(node, ast.Assign) else ():
        yield from (each.id for each in ast.walk(target) if isinstance(each, ast.Name))


def held_still(program: str, hold: Hold, *, has_own_calls: bool = False) -> str:
    """The program with a cause held still in every environment that it builds.

    What stands there already isn't put twice.
    """
    texts, modules = texts_of(hold.function)
    made = "make"
    if has_own_calls and any(f"def {with_class.__name__}(" in each for each in texts):
        texts = (*texts_of(calls_of_class)[0], *texts)
        made = f"{calls_of_class.__name__}(make)"
    begun, rest = after_make(program)
    head, found, body = begun.partition(MAKE)
    if not found:
        return program
    names = [*modules, *(["numpy as np"] if any("np." in each for each in texts) else [])]
    imports = [f"import {name}\n" for name in names]
    imports = [each for each in imports if f"\n{each}" not in f"\n{head}"]
    added = [f"{each}\n" for each in dict.fromkeys(texts) if f"\n{each}\n" not in body]
    held = "\n".join([*added, f"make = {hold.function.__name__}({made})\n"])
    return f"{head}{''.join(imports)}{MAKE}{body}\n{held}{rest}"


def pruned(program: str) -> str:
    """The program without functions, imports and constants that nothing else in it names."""
    try:
        nodes = ast.parse(program).body
    except SyntaxError:
        return program
    uses = [{each.id for each in ast.walk(node) if isinstance(each, ast.Name)} for node in nodes]
    lines: list[str | None] = [*program.splitlines()]
    for place, node in enumerate(nodes):
        defined = {*_defined(node)}
        if defined and defined.isdisjoint(set().union(*uses[:place], *uses[place + 1 :])):
            for at in range(node.lineno - 1, node.end_lineno or 0):
                lines[at] = None
    left = [each for each in lines if each is not None]
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(left)).rstrip() + "\n"
    return text if len(left) == len(lines) else pruned(text)


def _defined(node: ast.stmt) -> Iterator[str]:
    """Names that a statement defines and does nothing else; `make` is always wanted."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        yield from ((each.asname or each.name).partition(".")[0] for each in node.names)
    elif isinstance(node, ast.FunctionDef) or all(map(str.isupper, _bound(node))):
        yield from (each for each in _bound(node) if each != "make")


def draws_seeded(make: Callable[[], Any]) -> Callable[[], Any]:
    """Seeds the global generators before an environment is built."""

    def built() -> Any:
        np.random.seed(764_309)
        random.seed(764_309)
        return make()

    return built


SEEDED: Final = Hold("global generators seeded before an environment is built", draws_seeded)
SIMPLER: Final = {GLOBALS: (SEEDED, RESETS), RESETS: (SEEDED,)}
"""Holds that do as well for many programs, the simplest first."""
