"""Reproducers from functions: their source, with what they call, and a call of them."""

import ast
import inspect
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from types import FunctionType, ModuleType
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.literal import literal

HEADED: Final = {"seed": "SEED", "actions": "ACTIONS"}
"""Arguments that stand at the head of every reproducer."""
BOOKS: Final = ("rewards", "terminations", "truncations", "infos")


def reproducer_of(
    function: Callable[..., None],
    /,
    *,
    api: str = "parallel",
    options: Mapping[str, Any] | None = None,
    compares: bool = False,
    **values: Any,
) -> Reproducer:
    """A reproducer that calls a function which raises while the fault is there.

    Arguments without a value are what a reproducer has at hand: `make`, `plain`, `seed`, `actions`,
    and after the actions were played `env`, `terminations` and so on. Annotations are left out of
    its text: nothing of ours is imported there.

    Args:
        function: imports, beside numpy, what it needs from modules at the head of its own.
        api: `aec`: `terminations` and the like are those of `env`.
        options: what `make()` hands to the factory.
        compares: it compares two episodes, one of them with a trigger.
        values: its other arguments, written as literals.
    """
    books = {name: f"env.{name}" for name in BOOKS} if api == "aec" else {}
    at_hand = HEADED | books
    arguments = [
        literal(values[name]) if name in values else at_hand.get(name, name)
        for name in inspect.signature(function).parameters
    ]
    text, imports = text_of(function)
    return Reproducer(
        f"{text}\n\n{function.__name__}({', '.join(arguments)})",
        plays="env" in inspect.signature(function).parameters,
        imports=imports,
        options=options or {},
        compares=compares,
    )


def text_of(function: Callable[..., Any]) -> tuple[str, tuple[str, ...]]:
    """Source of a function and of those that it calls, and the modules that they need."""
    texts, modules = texts_of(function)
    return "\n\n".join(texts) + "\n", modules


@cache
def texts_of(function: Callable[..., Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sources of a function and of those that it calls, one each, and the modules they need."""
    functions: dict[Callable[..., Any], None] = {}
    modules: set[str] = set()

    def collect(one: Callable[..., Any]) -> None:
        if not isinstance(one, FunctionType) or one in functions:
            return
        functions[one] = None
        for name in _names(one):
            value = one.__globals__.get(name)
            if isinstance(value, ModuleType) and value.__name__ != "numpy":
                modules.add(value.__name__)
            elif isinstance(value, FunctionType):
                collect(value)

    collect(function)
    texts = (_unannotated(inspect.getsource(each)).rstrip() for each in reversed(functions))
    return tuple(texts), tuple(sorted(modules))


def _names(function: FunctionType) -> Iterator[str]:
    for node in ast.walk(ast.parse(_unannotated(inspect.getsource(function)))):
        if isinstance(node, ast.Name):
            yield node.id


def _unannotated(source: str) -> str:
    """The source without the types of arguments and results."""
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    starts = [sum(map(len, lines[:at])) for at in range(len(lines))]
    whole = b"".join(lines)
    spans = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.arg | ast.FunctionDef):
            note = node.annotation if isinstance(node, ast.arg) else node.returns
            if note is not None:
                first = starts[note.lineno - 1] + note.col_offset
                sign = b":" if isinstance(node, ast.arg) else b"->"
                last = starts[(note.end_lineno or 0) - 1] + (note.end_col_offset or 0)
                spans.append((len(whole[: whole.rindex(sign, 0, first)].rstrip()), last))
    for first, last in sorted(spans, reverse=True):
        whole = whole[:first] + whole[last:]
    return whole.decode()
