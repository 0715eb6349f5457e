"""The files that git keeps here, and what they import: what the tests of this folder look at."""

import ast
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "gamekeeper"


@cache
def kept_files() -> tuple[Path, ...]:
    """Every file that git tracks or would track; all files where there is no git (an archive)."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    if listing.returncode == 0:
        names = listing.stdout.decode().split("\0")
        return tuple(path for name in names if name and (path := ROOT / name).is_file())
    there = (path for path in ROOT.rglob("*") if path.is_file())
    return tuple(path for path in there if not is_made(path.relative_to(ROOT)))


def is_made(path: Path) -> bool:
    """Whether a tool made a path: it stands in a hidden folder, in build output or in evidence."""
    made = {"build", "dist", "runs", "__pycache__"}
    return any(x in made or (x.startswith(".") and x != ".ci") for x in path.parts[:-1])


@cache
def modules() -> dict[str, Path]:
    """The modules of the package by dotted name: `{"gamekeeper.episodes.episode": Path(...)}`."""
    return {dotted_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def dotted_name(path: Path) -> str:
    """`gamekeeper.episodes` for `src/gamekeeper/episodes/__init__.py`."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(tree: ast.AST, module: str, *, is_package: bool = False) -> Iterator[tuple[int, str]]:
    """Every imported name with its line, `from a import b` as `a.b`, relative ones made absolute.

    Imports inside functions and under TYPE_CHECKING count: they are dependencies of the text, too.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                up = parts[: len(parts) - node.level + is_package]
                base = ".".join([*up, base] if base else up)
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)
