"""Reference pages as text: every command with its options, every error with its meaning."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

EXAMPLE: Final = "Example: "
"""Start of a command's last paragraph; the rest is a line to type."""

_HEAD: Final = "<!-- written by `python -m gamekeeper.cli._reference docs/reference` -->"

_COMMANDS: Final = f"""\
# Commands

{_HEAD}

`gamekeeper COMMAND --help` says the same in a terminal. Every command takes `--json` (one JSON
document on stdout, all else on stderr) and `--quiet`; `--seed`, `--workers` and `--policy` are
taken everywhere, and a note says where one has no effect.

| exit code | meaning |
|---|---|
| 0 | passed, verified, done; checks that were not exercised are counted on stderr |
| 1 | failed, diverged |
| 2 | no answer, or wrong use; the reason is on stderr |
| 130 | interrupted by Ctrl-C |
"""

_ERRORS: Final = f"""\
# Errors

{_HEAD}

Every error that Gamekeeper raises on purpose is a `gamekeeper.errors.GamekeeperError`, and also the
builtin that Python raises for such a mistake. It names the failure, the place, the expected and the
actual value, and a fix; these are attributes: `what`, `where`, `expected`, `actual`, `fix`.

| error | is also a | says |
|---|---|---|
"""


@dataclass(frozen=True, slots=True)
class Parameter:
    """An argument or an option of a command.

    Attributes:
        names: name and metavar as typed: `--episodes N`, `ENV`.
        about: its help.
        default: as typed; None where the help text has it.
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
        rows.append(f"| {indent}`gk.{name}` | {builtins} | {_cell(about)} |\n")
    return _ERRORS + "".join(rows)


def _command(command: Command) -> str:
    words = " ".join(each.names for each in command.arguments)
    lines = [f"## {command.name}", "", f"`gamekeeper {command.name} {words}`".replace(" `", "`")]
    for paragraph in command.about:
        start, is_example, line = paragraph.partition(EXAMPLE)
        lines += ["", f"{EXAMPLE}`{line}`" if is_example and not start else paragraph]
    lines += ["", "| | |", "|---|---|"]
    for each in [*command.arguments, *command.options]:
        lines.append(f"| `{_code(each.names)}` | {_about(each)} |")
    return "\n".join(lines) + "\n"


def _about(parameter: Parameter) -> str:
    default = "" if parameter.default is None else f" Default: `{_code(parameter.default)}`."
    return f"{_cell(parameter.about)}{default}".strip()


def _cell(text: str) -> str:
    """Escapes a text for the cell of a table."""
    for mark in ("\\", "|", "<", "*", "_", "["):
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())


def _code(text: str) -> str:
    """Escapes the bars of code in the cell of a table, which backticks don't protect."""
    return text.replace("|", "\\|")
