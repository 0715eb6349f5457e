"""Size and structure of the source: the figures that a reader's first week hangs on.

    python benchmarks/structure.py                 # a JSON line for each figure
    python benchmarks/structure.py --names         # with the names behind each figure

Statements are those of Python's own syntax tree, docstrings left out, with every line of a template
that is program text (`*.j2` outside the report's page). A circle is a group of modules that import
one another, imports inside functions and for type checkers counted. A pair of duplicates is two
places with six or more equal lines; blank lines, comments, imports and lone brackets don't count.
"""

from __future__ import annotations

import argparse
import ast
import collections
import io
import json
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent / "src"
LEAST = 6
"""Equal lines that make a pair."""
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
THIN = re.compile(r"^[\s()\[\]{},:]*$|^\s*(from|import|#|\"\"\"|@)|^\s*(else|try|finally):$")


def modules() -> dict[str, Path]:
    """Every module by its dotted name."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def is_docstring(node: ast.AST) -> bool:
    """Whether a statement is text alone."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def prose_lines(source: str, tree: ast.AST) -> int:
    """Lines of docstrings and of comments."""
    texts = sum(
        (node.end_lineno or node.lineno) - node.lineno + 1
        for node in ast.walk(tree)
        if is_docstring(node)
    )
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return texts + sum(token.type == tokenize.COMMENT for token in tokens)


def imported(module: str, tree: ast.AST, known: dict[str, Path]) -> Iterator[str]:
    """Modules of ours that a module imports anywhere."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            for name in node.names:
                inner = f"{node.module}.{name.name}"
                yield inner if inner in known else node.module


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules each of which reaches the others (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(edges.get(node, ())):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in edges:
        if node not in index:
            visit(node)
    return found


def duplicates(paths: list[Path]) -> list[str]:
    """Pairs of places that share six or more lines, the longest run of each pair of files."""
    windows = collections.defaultdict(list)
    lines_of = {}
    for path in paths:
        lines = [
            (number, line.strip())
            for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
            if not THIN.match(line)
        ]
        lines_of[path] = lines
        for at in range(len(lines) - LEAST + 1):
            windows[tuple(text for _, text in lines[at : at + LEAST])].append((path, at))
    pairs: dict[tuple[Path, Path], tuple[int, int]] = {}
    for places in windows.values():
        for i, (one, at) in enumerate(places[:8]):
            for other, there in places[i + 1 : 8]:
                if one != other or abs(at - there) >= LEAST:
                    pairs.setdefault(
                        (one, other), (lines_of[one][at][0], lines_of[other][there][0])
                    )
    return [
        f"{one.relative_to(ROOT)}:{at} ~ {other.relative_to(ROOT)}:{there}"
        for (one, other), (at, there) in pairs.items()
    ]


def exported(known: dict[str, Path]) -> set[str]:
    """Names that the package's front offers."""
    tree = ast.parse(known["gamekeeper"].read_text("utf-8"))
    return {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """How many arguments a function takes, `self` left out."""
    arguments = function.args
    named = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    return sum(name.arg not in {"self", "cls"} for name in named)


def program_templates() -> int:
    """Lines of templates that become programs."""
    paths = [path for path in ROOT.rglob("*.j2") if "page" not in path.parts]
    return sum(bool(line.strip()) for path in paths for line in path.read_text().splitlines())


def strings_of_code(tree: ast.AST) -> int:
    """Lines of longer texts that are valid Python and do something."""
    lines = 0
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and "\n" in node.value:
            try:
                inner = ast.parse(node.value)
            except (SyntaxError, ValueError):
                continue
            if any(not isinstance(part, ast.Expr | ast.AnnAssign) for part in inner.body):
                lines += node.value.count("\n") + 1
    return lines


def figures() -> Iterator[tuple[str, Any, list[str]]]:
    """Every figure with the names behind it."""
    known = modules()
    sources = {module: path.read_text("utf-8") for module, path in known.items()}
    trees = {module: ast.parse(source) for module, source in sources.items()}
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    statements = sum(isinstance(node, ast.stmt) and not is_docstring(node) for node in nodes)
    statements += program_templates()
    prose = sum(prose_lines(sources[module], tree) for module, tree in trees.items())
    yield "statements", statements, []
    yield "lines", sum(source.count("\n") for source in sources.values()), []
    yield "docstring and comment lines a statement", round(prose / statements, 3), []
    yield "files", len(known), []

    classes = collections.defaultdict(set)
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                classes[node.name].add(module)
    shared = {name: places for name, places in classes.items() if len(places) > 1}
    yield (
        "class names in more than one file",
        len(shared),
        [f"{name}: {' '.join(sorted(places))}" for name, places in sorted(shared.items())],
    )

    names = collections.Counter(path.name for path in known.values())
    recurring = sorted(name for name, n in names.items() if n > 1 and name != "__init__.py")
    yield "recurring file names", len(recurring), recurring

    edges = {
        module: {other for other in imported(module, tree, known) if other != module}
        for module, tree in trees.items()
        if module != "gamekeeper"
    }
    groups = circles(edges)
    yield "circles", len(groups), [" ".join(group) for group in groups]

    functions = [
        (module, node)
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, FUNCTIONS)
    ]
    lengths = sorted((node.end_lineno or 0) - node.lineno + 1 for _, node in functions)
    yield "function lines, median", lengths[len(lengths) // 2], []
    yield "function lines, p95", lengths[int(len(lengths) * 0.95)], []
    long = [
        f"{module}:{node.name}"
        for module, node in functions
        if (node.end_lineno or 0) - node.lineno + 1 > 80
    ]
    yield "functions over 80 lines", len(long), long
    public = exported(known)
    many = [
        f"{module}:{node.name} {parameters(node)}"
        for module, node in functions
        if parameters(node) >= 10
        and node.name not in public
        and not module.startswith(("gamekeeper.cli", "gamekeeper.tasks", "gamekeeper.tasks"))
    ]
    yield "functions of ten or more parameters", len(many), many

    folders = collections.Counter(path.parent for path in known.values())
    full = [f"{folder.relative_to(ROOT)} {n}" for folder, n in folders.items() if n > 25]
    yield "folders of more than 25 files", len(full), full
    pairs = duplicates(list(known.values()))
    yield "pairs of duplicates", len(pairs), pairs
    code = {module: strings_of_code(tree) for module, tree in trees.items()}
    yield (
        "lines of Python in strings",
        sum(code.values()),
        [f"{module} {n}" for module, n in sorted(code.items(), key=lambda item: -item[1]) if n],
    )


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--names", action="store_true", help="the names behind each figure")
    names = parser.parse_args().names
    for what, value, behind in figures():
        print(json.dumps({"what": what, "value": value, **({"names": behind} if names else {})}))


if __name__ == "__main__":
    main()
