"""`gamekeeper new NAME`: a package for a new task, whose tests pass at once."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, TypeVar

import typer

from gamekeeper.cli._options import Count
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError
from gamekeeper.import_guard import unguarded

if TYPE_CHECKING:
    from gamekeeper.scaffold.task_plan import Plan
    from gamekeeper.scaffold.timing import TimingAdvice

ORDER: Final = 12
T = TypeVar("T")


@unguarded()  # the user names what is run
def command(
    screen: Screen,
    name: str,
    agents: list[str] | None = None,
    stages: str | None = None,
    sees: Literal["no", "yes"] | None = None,
    order: Literal["none", "fixed", "rotating", "state", "random"] | None = None,
    conflicts: Literal["joint rule", "priority", "random", "ordered"] | None = None,
    observes: list[str] | None = None,
    acts: list[str] | None = None,
    reward: list[str] | None = None,
    ending: list[str] | None = None,
    horizon: Count | None = None,
    api: Literal["aec", "parallel"] | None = None,
    out: Path | None = None,
    yes: bool = False,
) -> CommandResult:
    """Writes a package with environment, contract, tests and CI; its tests pass at once.

    Asks for agents, order, spaces, rewards and endings, and advises from the answers if the task
    is better an AECEnv or a ParallelEnv, and why. Options answer beforehand; without a terminal
    the defaults are used.

    Example: gamekeeper new my_task --agents picker=2 --agents carrier=1

    Args:
        name (NAME): Name of the package: my_task.
        agents (--agents ROLE=N): Role and number of its agents. Repeatable (default: robot=2).
        stages (--stages TEXT): Roles that act together or in turn: picker+carrier, or
            picker,carrier (default: all together).
        sees (--sees): Agents observe others' actions of the same round before they act (default:
            no).
        order (--order): Order of agents that act together; none: all at once (default: none, or
            fixed with --sees yes).
        conflicts (--conflicts): Rule for actions that exclude each other (default: joint rule).
        observes (--observes [ROLE=]SPACE): Observation space of a role. Repeatable (default:
            box:4).
        acts (--acts [ROLE=]SPACE): Action space of a role: discrete:5, box:3x3, multidiscrete:3,2
            or multibinary:4. Repeatable (default: discrete:3).
        reward (--reward TERM=KIND:EARNER:PAYEE): Reward term: individual, shared or zero-sum;
            earner and payee are a role, all or earner. Repeatable (default: goal=shared:all:all).
        ending (--ending NAME=KIND:OWNER): Ending beside the time limit: termination or truncation,
            of agent, all or a role. Repeatable (default: done=termination:all).
        horizon (--horizon N): Length of an episode, in ticks (default: 100).
        api (--api): PettingZoo API of the task (default: the advised one).
        out (--out FOLDER): Folder to write, new or empty (default: ./NAME).
        yes (--yes, -y): Ask no questions; use the defaults.
    """
    from gamekeeper.scaffold.interview import Answers, plan_of, usual
    from gamekeeper.scaffold.package_files import files_of

    answers = Answers(
        name=name,
        agents=agents or (),
        stages=stages,
        sees=sees,
        order=order,
        conflicts=conflicts,
        observes=observes or (),
        acts=acts or (),
        reward=reward or (),
        ending=ending or (),
        horizon=horizon,
        api=api,
    )
    is_asking = not yes and not screen.is_json and sys.stdin is not None and sys.stdin.isatty()
    if is_asking:
        plan, advice = plan_of(answers, _ask, advised=lambda said: _advise(screen, said))
    else:
        plan, advice = plan_of(answers, usual)
    files = files_of(plan)
    folder = Path(plan.name) if out is None else out
    _write(folder, files)
    _show(screen, plan, advice, folder, list(files))
    return CommandResult(
        {
            "name": plan.name,
            "folder": str(folder),
            "api": plan.api,
            "advice": advice.api,
            "why": advice.why,
            "files": list(files),
        }
    )


def _ask(question: str, answer: str, read: Callable[[str], T]) -> T:
    """Asks on the terminal until the answer can be read; Enter takes the usual one.

    Raises:
        KeyboardInterrupt: by Ctrl-C, or at the end of what is typed.
    """
    while True:
        try:
            said: str = typer.prompt(question, default=answer, err=True)
        except typer.Abort:
            raise KeyboardInterrupt from None
        try:
            return read(said)
        except GamekeeperError as error:
            typer.echo(str(error), err=True)


def _advise(screen: Screen, advice: TimingAdvice) -> None:
    screen.note(f"Advice: {advice.api}, because {advice.why}.")


def _show(screen: Screen, plan: Plan, advice: TimingAdvice, folder: Path, files: list[str]) -> None:
    """Says what was written, why in this interface, and what to type next."""
    because = f"{advice.api}: {advice.why}"
    if plan.api != advice.api:
        because += f". It is written as {plan.api}, as you wanted"
    from gamekeeper.scaffold.package_files import audit_line, spec_of

    indent = " " * 10
    told = textwrap.fill(
        because, screen.width, initial_indent="Advice    ", subsequent_indent=indent
    )
    listed = "\n".join(f"  {file}" for file in files)
    next_lines = [
        f"Next      cd {folder}",
        f'{indent}python -m pip install -e ".[test]"',
        f"{indent}python -m pytest",
        f"{indent}{audit_line(plan)}",
        f"{indent}gamekeeper run {spec_of(plan)} --policy reference",
    ]
    screen.show(told)
    screen.show(f"Written   {folder}\n{listed}")
    screen.show("\n".join(next_lines))


def _write(folder: Path, files: dict[str, str]) -> None:
    """Writes all files into a folder that is new, or empty; nothing is ever overwritten.

    Raises:
        GamekeeperError: something is in the folder, or it can't be written.
    """
    try:
        if folder.exists() and any(folder.iterdir()):
            raise GamekeeperError(
                "something is in the folder already",
                where=str(folder),
                expected="a new folder, or an empty one",
                fix="name another one with --out; nothing is ever overwritten",
            )
        for name, text in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8", newline="\n") as file:
                file.write(text)
    except OSError as error:
        raise GamekeeperError(
            "the package can't be written",
            where=str(folder),
            actual=error.strerror or str(error),
            fix="name a folder that you may write to with --out",
        ) from None
