"""Files and functions stay of a size that one reads whole, under names that say what is in them."""

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.surface.sources import ROOT, kept_files, modules

FILE_LINES = 600
FUNCTION_LINES = 60
NO_NAMES = {"utils", "util", "helpers", "helper", "common", "misc"}


def python_files() -> list[Path]:
    """All kept Python files."""
    return [path for path in kept_files() if path.suffix == ".py"]


def function_lengths(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Name and number of lines of each function, its docstring and decorators not counted."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or node.end_lineno is None:
            continue
        first = node.body[0]
        text = first.value if isinstance(first, ast.Expr) else None
        documented = isinstance(text, ast.Constant) and isinstance(text.value, str)
        doc_lines = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
        yield node.name, node.end_lineno - node.lineno + 1 - doc_lines


def test_file_is_short_enough_to_read() -> None:
    """No Python file is longer than 600 lines."""
    counts = {p: len(p.read_text(encoding="utf-8").splitlines()) for p in python_files()}
    assert {str(p.relative_to(ROOT)): n for p, n in counts.items() if n > FILE_LINES} == {}


def test_function_is_short_enough_to_read() -> None:
    """No function of the package is longer than 60 lines without its docstring."""
    too_long = [
        (module, name, lines)
        for module, path in modules().items()
        for name, lines in function_lengths(ast.parse(path.read_text(encoding="utf-8")))
        if lines > FUNCTION_LINES
    ]
    assert too_long == []


def test_file_name_says_what_is_inside() -> None:
    """No file or folder is called utils, helpers, common or misc."""
    names = {part.removesuffix(".py") for p in python_files() for part in p.relative_to(ROOT).parts}
    assert names & NO_NAMES == set()


def test_length_leaves_the_docstring_out() -> None:
    """A long explanation does not make a function long."""
    source = 'def f():\n    """One.\n\n    Two.\n    """\n    return 1\n'
    assert list(function_lengths(ast.parse(source))) == [("f", 2)]
