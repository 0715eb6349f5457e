"""Writes pages of commands and errors: `python -m gamekeeper.cli._reference docs/reference`."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from gamekeeper import errors
from gamekeeper.cli._app import build_app
from gamekeeper.reporting.reference_pages import Command, Parameter, commands_page, errors_page


def pages() -> dict[str, str]:
    """The pages by their files' names."""
    return {"commands.md": commands_page(_commands()), "errors.md": errors_page(_errors())}


def _commands() -> Iterator[Command]:
    group: Any = typer.main.get_command(build_app())
    for name, command in group.commands.items():
        context = command.context_class(command, info_name=name)
        shown = [each for each in command.params if not getattr(each, "hidden", False)]
        about = [" ".join(part.split()) for part in (command.help or "").split("\n\n")]
        arguments = [_argument(each) for each in shown if each.param_type_name == "argument"]
        options = [_option(each, context) for each in shown if each.param_type_name == "option"]
        yield Command(name, about, arguments, options)


def _argument(each: Any) -> Parameter:
    words = (each.metavar or each.name.upper()) + "..." * (each.nargs == -1)
    return Parameter(words if each.required else f"[{words}]", each.help or "", None)


def _option(each: Any, context: Any) -> Parameter:
    names = each.get_help_record(context)[0]  # as --help shows it
    is_shown = isinstance(each.default, str | int | float) and not isinstance(each.default, bool)
    return Parameter(names, each.help or "", str(each.default) if is_shown else None)


def _errors() -> Iterator[tuple[str, int, str, str]]:
    return _under(errors.GamekeeperError, 0)


def _under(kind: type, depth: int) -> Iterator[tuple[str, int, str, str]]:
    plain = [base for base in kind.__mro__ if base.__module__ == "builtins"]
    shown = plain[: max(len(plain) - 3, 1)]  # Exception, BaseException and object say nothing
    about = (inspect.getdoc(kind) or "").split("\n\n")[0]
    yield kind.__name__, depth, ", ".join(f"`{base.__name__}`" for base in shown), about
    known: list[type] = kind.__subclasses__()
    for other in known:
        if other.__module__ == errors.__name__:
            yield from _under(other, depth + 1)


def main() -> None:
    """Writes the pages into the folder that is named."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
