"""Reference pages as text: every command with its options, every error with what it is for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

_HEAD: Final = "<!-- written by `python -m gamekeeper.cli._reference docs/reference` -->"

_COMMANDS: Final = f"""\
# Commands

{_HEAD}

`gamekeeper COMMAND --help` says the same in a terminal. Every command takes `--json` (one JSON
document on stdout, all else on stderr) and `--quiet`; `--seed`, `--workers` and `--policy` are
taken everywhere, and where they change nothing the command says so.

| exit code | meaning |
|---|---|
| 0 | kept, verified, done; checks that saw nothing are counted on stderr |
| 1 | broken, diverged, failed |
| 2 | can't tell, or wrong use; the reason is on stderr |
| 130 | interrupted by Ctrl-C |
"""

_ERRORS: Final = f"""\
# Errors

{_HEAD}

Every error that Gamekeeper raises on purpose is a `gamekeeper.errors.GamekeeperError`, and also the
builtin that such a mistake is in Python. It says what went wrong, where, what was expected and
seen, and how to mend it; the parts are attributes: `what`, `where`, `expected`, `seen`, `mend`.

| error | is also a | says |
|---|---|---|
"""


@dataclass(frozen=True, slots=True)
class Parameter:
    """An argument or an option of a command.

    Attributes:
        names: as it is typed: `--episodes N`, `ENV`.
        about: its help.
        default: as it is typed; None where there is none.
    """

    names: str
    about: str
    default: str | None


@dataclass(frozen=True, slots=True)
class Command:
    """A command of the command line."""

    name: str
    about: Sequence[str]
    arguments: Sequence[Parameter]
    options: Sequence[Parameter]


def commands_page(commands: Iterable[Command]) -> str:
    """The page of all commands, in the order in which `--help` lists them."""
    return "\n".join([_COMMANDS, *(_command(each) for each in commands)])


def errors_page(errors: Iterable[tuple[str, int, str, str]]) -> str:
    """The page of all errors.

    Args:
        errors: name, depth in the tree, the builtins that it is too, its docstring; parents first.
    """
    rows = []
    for name, depth, builtins, about in errors:
        indent = "&emsp;" * max(depth - 1, 0)
        rows.append(f"| {indent}`{name}` | {builtins} | {_cell(about)} |\n")
    return _ERRORS + "".join(rows)


def _command(command: Command) -> str:
    words = " ".join(each.names for each in command.arguments)
    lines = [f"## {command.name}", "", f"`gamekeeper {command.name} {words}`".replace(" `", "`")]
    for paragraph in command.about:
        lines += ["", paragraph]
    told = [*command.arguments, *command.options]
    if told:
        lines += ["", "| | |", "|---|---|"]
        lines += [f"| `{_code(each.names)}` | {_told(each)} |" for each in told]
    return "\n".join(lines) + "\n"


def _told(parameter: Parameter) -> str:
    default = "" if parameter.default is None else f" Default: `{_code(parameter.default)}`."
    return f"{_cell(parameter.about)}{default}".strip()


def _cell(text: str) -> str:
    """Text that a table's cell can hold as it is."""
    for mark in ("\\", "|", "<", "*", "_", "["):
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())


def _code(text: str) -> str:
    """What stands between backticks in a table's cell; a bar there has to be escaped too."""
    return text.replace("|", "\\|")
