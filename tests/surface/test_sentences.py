"""What a person reads is plain: openings of docstrings, words of the house, names of classes.

The words are those of the project's glossary: the field's word where the field has one.
"""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from tests.surface.sources import PACKAGE, ROOT, kept_files, modules

OPENING = re.compile(
    r"(?:who|whom|whose|what|whether|which|how|where|why|of|nobody|nothing)\b", re.IGNORECASE
)

# A letter stands in brackets in each word, so that the list doesn't find itself.
DIALECT = "[c]rossing [s]ham [m]end [o]ccasion [t]win [s]pecimen [r]emedy [s]tressor [t]ape [r]eel"
DIALECT += " [p]ress [d]esk [b]undle [p]arting [u]nseen"
WORD = re.compile(
    rf"(?<![A-Za-z])(?:{'|'.join(DIALECT.split())})(?:s|es|ed|ing)?(?![a-z])", re.IGNORECASE
)
EXCEPTIONS = {
    "press": "a key or a button",
    "pressed": "a key or a button",
    "presses": "a key or a button",
    "pressing": "a key or a button",
}
"""Words that have another meaning in the field, with that meaning; none of our own may have it."""
NAME_OF_OTHERS = "marl-warehouse-digital-twin"
"""A public repository, which docs/zoo.md names."""


def docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of each docstring, those of attributes too."""
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            yield node.lineno, node.value.value.strip()


def forbidden(text: str) -> list[str]:
    """Words of a text that the glossary replaces."""
    found = (match.group() for match in WORD.finditer(text.replace(NAME_OF_OTHERS, "")))
    return [word for word in found if word.lower() not in EXCEPTIONS]


def test_docstrings_open_with_a_verb_or_a_noun() -> None:
    """No docstring opens with a relative clause."""
    found = [
        f"{module}:{line}: {text.splitlines()[0]}"
        for module, path in modules().items()
        for line, text in docstrings(ast.parse(path.read_text(encoding="utf-8")))
        if OPENING.match(text)
    ]
    assert found == []


def texts() -> list[Path]:
    """Files that are read by people: sources, pages and the README; not scripts of others."""
    shown = {".py", ".md", ".toml", ".j2", ".js", ".css", ".html"}
    return [
        path
        for path in kept_files()
        if path.suffix in shown
        and not path.name.endswith(".min.js")
        and (path == ROOT / "README.md" or {ROOT / "docs", PACKAGE} & set(path.parents))
        and ROOT / "docs" / "findings" not in path.parents  # programs and names of others
    ]


def test_words_are_those_of_the_field() -> None:
    """No word of the former dialect stands in sources or pages."""
    found = {
        str(path.relative_to(ROOT)): words
        for path in texts()
        if (words := forbidden(path.read_text(encoding="utf-8")))
    }
    assert found == {}


def test_words_are_found() -> None:
    """Plural, capital and part of a name count; words that only contain one don't."""
    assert forbidden("[T]wins, a [r]eel_id, un[m]end".replace("[", "").replace("]", "")) == [
        "Twins",
        "reel",
    ]
    assert forbidden("express, between, tapestry, press a key") == []


def test_a_class_name_stands_once() -> None:
    """Where two want the same noun, the noun is too vague; private classes too."""
    where = defaultdict(set)
    for module, path in modules().items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                where[node.name].add(module)
    assert {name: files for name, files in where.items() if len(files) > 1} == {}


JARGON = {"trace", "traces", "_trace", "cast", "_cast", "course", "film", "seat", "seats"}
"""Names of an episode, a joint policy, actions, a track and a position before they had one word."""
ELSEWHERE = {
    "gamekeeper.viewing.video_file",
    "gamekeeper.interface.casting",
    "gamekeeper.interface.authoring",
}
"""Modules in which one of them is the field's own word."""


def test_names_are_those_of_the_glossary() -> None:
    """One thing has one name: no variable, argument or function has one of the former names."""
    found = {}
    for module, path in modules().items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = {
            getattr(node, "name", None) or getattr(node, "arg", None) or getattr(node, "id", None)
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef | ast.arg)
            or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
        }
        if module not in ELSEWHERE and names & JARGON:
            found[module] = names & JARGON
    assert found == {}
