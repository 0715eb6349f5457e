"""Frame around every command: its common options, its outputs, its exit code."""

import errno
import importlib
import inspect
import pkgutil
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

from gamekeeper._version import __version__
from gamekeeper.cli._options import annotations_of, hidden
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli._stdout import claimed_stdout, open_standard_streams, silence
from gamekeeper.errors import EnvError, GamekeeperError
from gamekeeper.rollouts.interrupts import lost_interrupts_again

PACKAGE: Final = "gamekeeper.cli"
NAME: Final = "gamekeeper"
FAILED: Final = 1
UNSURE: Final = 2
INTERRUPTED: Final = 130
NAME_CHARS: Final = 200
"""Characters that are shown of a file's name that is too long."""
VALIDATOR: Final = "Value error, "
"""Text that typer's validator puts in front of its reason; it tells a user nothing."""
LAST: Final = 1_000
"""Place in the list of commands of one without `ORDER`."""
GROUPS: Final = {
    0: "Begin",
    15: "Environments",
    30: "Runs",
    80: "Causes and figures",
    97: "View",
    120: "Share",
    LAST: "More",
}
"""Headings in the list of commands, by the first `ORDER` below each."""
TYPE: Final = re.compile(r" <(?:str|path|list\[\w+\])>$")
"""Python's name of an argument's type, which typer puts behind the argument's."""

OWN: Final = ("json", "quiet")
"""Options that the frame itself handles."""
COMMON: Final = {"json": False, "quiet": False, "seed": 0, "workers": 1, "policy": None}
"""Options that every command takes, with their defaults; a note says where one has no effect."""


def run_line(arguments: Sequence[str] | None = None) -> int:
    """Runs a command line and returns its exit code."""
    open_standard_streams()
    line = list(sys.argv[1:] if arguments is None else arguments)
    with _signals():
        try:
            code = build_app()(line, prog_name=NAME, standalone_mode=False)
            sys.stdout.flush()
        except typer.Abort:
            return INTERRUPTED
        except OSError as error:  # of --help and --version: commands write by their screen
            silence(sys.stdout)
            return _unwritten(Screen(sys.stdout), error)
        except Exception as error:
            # Whatever typer finds wrong with a line has these two; its class isn't public.
            if not (hasattr(error, "format_message") and hasattr(error, "exit_code")):
                raise
            return _misused(error, as_json="--json" in line)
    return code if isinstance(code, int) else 0


def build_app() -> typer.Typer:
    """The whole command line, every module of this package that is a command in it."""
    app = typer.Typer(
        name=NAME,
        cls=GroupedCommands,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # rich alone doubles the time that --help takes
        context_settings={"help_option_names": ["--help", "-h"]},
        help="Tests, records and reproduces PettingZoo environments: checks their rules, records "
        "episodes that replay bit for bit, and finds the agent that made a run fail. "
        "Episodes and turns are counted from 0.",
        epilog="Example: gamekeeper run warehouse --policy reference. Exit codes: 0 passed, "
        "verified, done; 1 failed, diverged; 2 no answer, or wrong use; 130 interrupted.",
    )
    app.callback()(_whole)
    for name, module in commands():
        # The whole first line: typer cuts it where it doesn't fit beside the names.
        first_line = (inspect.getdoc(module.command) or "").partition("\n")[0]
        app.command(name, short_help=first_line, cls=PlainCommand)(framed(name, module))
    return app


class PlainCommand(TyperCommand):
    """Command whose help names arguments as the documentation does, without Python's types."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Returns the words of the usage line: `RUN...` and not `{RUN}...`."""
        return [re.sub(r"^\{(.*)\}", r"\1", each) for each in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Writes arguments and options into the formatter."""
        write = formatter.write_dl
        formatter.write_dl = lambda rows: write([(TYPE.sub("", name), text) for name, text in rows])
        super().format_options(ctx, formatter)


class GroupedCommands(TyperGroup):
    """Commands under headings, by what they are for."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Writes each group's commands into the formatter, their first lines whole."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, module in commands():
            order = getattr(module, "ORDER", LAST)
            heading = GROUPS[max(first for first in GROUPS if first <= order)]
            groups.setdefault(heading, []).append((name, self.commands[name].short_help or ""))
        column = max(len(name) for rows in groups.values() for name, _ in rows)
        for heading, rows in groups.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(column), text) for name, text in rows])


def commands() -> list[tuple[str, ModuleType]]:
    """Names and modules of the commands, in the order in which they are shown."""
    names = [info.name for info in pkgutil.iter_modules(importlib.import_module(PACKAGE).__path__)]
    modules = [
        (name.replace("_", "-"), importlib.import_module(f"{PACKAGE}.{name}"))
        for name in names
        if not name.startswith("_")
    ]
    return sorted(modules, key=lambda named: (getattr(named[1], "ORDER", LAST), named[0]))


def framed(name: str, module: ModuleType) -> Callable[..., None]:
    """Wraps a command for typer: adds the common options, handles its outputs and errors."""
    command: Callable[..., CommandResult] = module.command
    known = annotations_of(command)
    screen_, *own = inspect.signature(command).parameters.values()
    del screen_
    declared = [each.replace(annotation=known[each.name]) for each in own]
    added = _added({each.name for each in own}, known)

    def run(**options: Any) -> None:
        own = {key: options.pop(key) for key in OWN}
        idle = {p.name: options.pop(p.name) for p in added if p.name not in OWN}
        with claimed_stdout() as out:
            screen = Screen(out, is_json=own["json"], is_quiet=own["quiet"])
            for parameter in added:
                if parameter.name in idle and idle[parameter.name] != parameter.default:
                    screen.note(f"note: --{parameter.name} has no effect on {name}")
            code = _performed(command, screen, options, idle_policies=idle.get("policy"))
        if screen.lost and code != INTERRUPTED:
            code = _unwritten(screen, screen.lost[0])
        raise typer.Exit(code)

    parameters = [*declared, *added]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # typer reads it
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__doc__ = (inspect.getdoc(command) or "").partition("\n\nArgs:\n")[0]
    return run


def _added(declared: set[str], known: Mapping[str, Any]) -> list[inspect.Parameter]:
    """The common options that a command doesn't declare; those without effect are hidden."""
    kind = inspect.Parameter.KEYWORD_ONLY
    added = []
    for name, default in COMMON.items():
        if name not in declared:
            shown = known[name] if name in OWN else hidden(known[name])
            added.append(inspect.Parameter(name, kind, default=default, annotation=shown))
    return added


def _performed(
    command: Callable[..., CommandResult],
    screen: Screen,
    options: dict[str, Any],
    *,
    idle_policies: Sequence[str] | None,
) -> int:
    """Runs a command, writes its document or its error, and returns the exit code."""
    try:
        if idle_policies:
            from gamekeeper.interface.policy import check_spelling

            check_spelling(idle_policies)  # misspelt, it may be meant for another command
        answer = command(screen, **options)
    except GamekeeperError as error:
        if (stopped := _interrupt_in(error)) is not None:
            return _interrupted(screen, stopped)
        screen.error(f"{type(error).__name__}: {error}")
        screen.document({"error": error.to_json()})
        return FAILED if isinstance(error, EnvError) else UNSURE
    except KeyboardInterrupt as stopped:
        return _interrupted(screen, stopped)
    except Exception as error:
        if (stop := _interrupt_in(error)) is not None:
            return _interrupted(screen, stop)
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            what = f"a name is too long for the system: {str(error.filename)[:NAME_CHARS]}..."
            screen.error(what)
            screen.document({"error": {"kind": "OSError", "what": what}})
            return UNSURE
        screen.error(traceback.format_exc())
        screen.error("This is a fault of gamekeeper, not of your environment: please report it.")
        line = traceback.format_exception_only(error)[-1].strip()
        screen.document({"error": {"kind": "Fault", "what": f"a fault of gamekeeper: {line}"}})
        return UNSURE
    screen.document(answer.document)
    return answer.code


def _interrupt_in(error: BaseException) -> KeyboardInterrupt | None:
    """The Ctrl-C that was being handled while this was raised: cleaning up may fail, too."""
    context: BaseException | None = error
    while context is not None:
        if isinstance(context, KeyboardInterrupt):
            return context
        context = context.__context__
    return None


def _interrupted(screen: Screen, stopped: KeyboardInterrupt) -> int:
    """Says so, with what was known by then."""
    known = list(getattr(stopped, "__notes__", ()))
    screen.error("interrupted")
    for line in known:
        screen.error(line)
    error = {"kind": "Interrupted", "what": "interrupted"}
    screen.document({"error": {**error, "known": known} if known else error})
    return INTERRUPTED


def _unwritten(screen: Screen, error: OSError) -> int:
    """Reports that results couldn't be written: the command's own exit code would mislead.

    A reader that left, as `head` does, knows it: nothing is said then.
    """
    if isinstance(error, BrokenPipeError):
        return UNSURE
    screen.error(f"stdout can't be written: {error.strerror or error}")
    return UNSURE


def _misused(error: Any, *, as_json: bool) -> int:
    """Reports the mistake in a command line, as typer would."""
    if type(error).__name__ == "NoArgsIsHelpError":  # its message is the help, said already
        return UNSURE
    if isinstance(getattr(error, "message", None), str):
        error.message = error.message.removeprefix(VALIDATOR)
    if as_json:
        document = {"error": {"kind": "UsageError", "what": error.format_message()}}
        with claimed_stdout() as out:
            Screen(out, is_json=True).document(document)
    error.show()
    return int(error.exit_code)


@contextmanager
def _signals() -> Iterator[None]:
    """Ctrl-C, kill and a terminal that closes all interrupt, so that evidence is finalized.

    A shell starts background jobs with Ctrl-C ignored; a `kill -INT` from a script is meant.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler)}
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            before[number] = signal.signal(number, lambda *_: signal.raise_signal(signal.SIGINT))
    undo = lost_interrupts_again()
    try:
        yield
    finally:
        undo()
        for number, handler in before.items():
            signal.signal(number, handler)


def _show_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(f"{NAME} {__version__}")
        raise typer.Exit


def _whole(
    *,
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Show the version."
    ),
) -> None:
    # No docstring: typer would show it in place of the help text that is given above.
    del version
