"""Reward terms and endings that an author's rules name, read from the source of the class."""

import ast
import inspect
import textwrap
from collections.abc import Iterable, Iterator

from gamekeeper.contract import Ending, RewardTerm
from gamekeeper.interface.author_calls import TERMINATED, TRUNCATED

ENDS = {"terminate": ("termination", TERMINATED), "truncate": ("truncation", TRUNCATED)}
"""Kind of an ending, and its name where none is given, by the verb."""


def named_in(kinds: Iterable[type]) -> tuple[dict[str, RewardTerm], dict[str, Ending]]:
    """Terms and endings that classes name in plain text, in the order of their source.

    What is named by an expression isn't found: without it the source is still the author's word.
    """
    terms: dict[str, RewardTerm] = {}
    endings: dict[str, Ending] = {}
    for kind in kinds:
        for verb, arguments, named in _calls(kind):
            if verb == "add_reward":
                term = _text(named.get("term", arguments[2] if len(arguments) > 2 else None))
                if term is not None:
                    terms.setdefault(term, RewardTerm())
            elif verb in ENDS:
                what, usual = ENDS[verb]
                given = named.get("reason", arguments[1] if len(arguments) > 1 else None)
                reason = usual if given is None else _text(given)
                if reason is not None:
                    endings.setdefault(reason, Ending(kind=what))
    return terms, endings


def _calls(kind: type) -> Iterator[tuple[str, list[ast.expr], dict[str | None, ast.expr]]]:
    """Calls of methods in a class: name, arguments by place and by name."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    except (OSError, TypeError, SyntaxError):  # typed at a prompt, or made by a program
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            yield node.func.attr, node.args, {each.arg: each.value for each in node.keywords}


def _text(node: ast.expr | None) -> str | None:
    value = node.value if isinstance(node, ast.Constant) else None
    return value if isinstance(value, str) and value else None
