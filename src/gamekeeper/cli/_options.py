"""Arguments and options of commands, as their signatures and docstrings declare them.

The parameters of a command are its arguments and options. Its docstring says under `Args` how each
is typed and what it means, as `rows (--rows N): Most rows that are shown.`; a parameter that isn't
there is one of the options that several commands share, of the same name. Its default is the
signature's, its limits and its completion are an `Annotated` type's, as in `Count`.
"""

import inspect
import json
import re
from collections.abc import Callable
from copy import copy
from functools import cache
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Final,
    Literal,
    NamedTuple,
    TypeAlias,
    get_args,
    get_origin,
    get_type_hints,
)

import typer

from gamekeeper.cli import _completion
from gamekeeper.errors import GamekeeperError

EPISODES: Final = 20
SILENCE_S: Final = 60.0
"""Longest time without a turn before an environment counts as hung, in seconds."""
MOST: Final = (1 << 31) - 1
"""Highest count of anything: evidence numbers episodes and turns in 31 bits."""
MOST_SEED: Final = (1 << 62) - 1
"""Highest seed: NumPy's integers hold it, and the seeds that are derived by adding to it."""
MOST_WORKERS: Final = 4_096
"""Highest number of processes of one command."""
MOST_S: Final = 1_000_000.0
"""Longest timeout, eleven days; the system's own waits end at twice that."""
ENTRY: Final = re.compile(r"(\w+) \(([^)]+)\): (.*)")
"""Entry of a docstring's `Args`."""


class Accepted(NamedTuple):
    """Values that an argument or option accepts, and the function that completes them."""

    min: float | None = None
    max: float | None = None
    autocompletion: Callable[[str], list[str]] | None = None


Count: TypeAlias = Annotated[int, Accepted(1, MOST)]
Number: TypeAlias = Annotated[int, Accepted(0, MOST)]
Seed: TypeAlias = Annotated[int, Accepted(0, MOST_SEED)]
Workers: TypeAlias = Annotated[int, Accepted(1, MOST_WORKERS)]
CheckId: TypeAlias = Annotated[str, Accepted(autocompletion=_completion.checks)]


def shared(
    *,
    env: Annotated[str, Accepted(autocompletion=_completion.environments)],
    run: Annotated[Path, Accepted(autocompletion=_completion.runs)],
    policy: Annotated[list[str], Accepted(autocompletion=_completion.policies)] | None,
    episodes: Count,
    seed: Seed,
    out: Path | None,
    level: Literal["full", "digest", "actions"],
    frames: bool,
    contract: Path | None,
    kwargs: str | None,
    options: str | None,
    timeout: Annotated[float, Accepted(0.1, MOST_S)],
    memory: Annotated[int, Accepted(1)] | None,
    tolerance: Annotated[float, Accepted(0.0)] | None,
    allow_import: bool,
    budget: Count,
    quick: bool,
    workers: Workers | None,
    executor: str | None,
    json: bool,
    quiet: bool,
) -> None:
    """Declares the arguments and options that several commands share; it is never called.

    Args:
        env (ENV): Environment: warehouse, butterfly/pistonball-v6, path/to/file.py:factory or
            mpe2.simple_spread_v3:parallel_env. In front, parallel: or aec: selects the API.
        run (RUN): Folder of a recorded run.
        policy (--policy [AGENT|ROLE=]POLICY): Policy of all agents, an agent or a role: random,
            first-legal, noop, reference (of Gamekeeper's own tasks), module:callable or
            file.py:callable, called as policy(observation, agent, info, rng) for an action, or
            same:AGENT to share that agent's policy object. Repeatable (default: random; of a run,
            the recorded policies).
        episodes (--episodes N): Number of episodes to play.
        seed (--seed N): Seed from which the seeds of all episodes are derived.
        out (--out FOLDER): Folder of the run that is written (default: the first free one of
            runs/NAME-1, runs/NAME-2, ...).
        level (--level): Content of the run: every value (full), hashes in place of observations
            (digest), or seeds, actions, rewards and flags, to be played again by `gamekeeper
            expand` (actions).
        frames (--frames): Render every step into RUN/frames, as rgb_array where the environment has
            it, else as ansi; a render_mode in --kwargs takes precedence.
        contract (--contract FILE): Contract of the environment (default: the TOML file beside the
            environment's file, if there is one).
        kwargs (--kwargs JSON): Keyword arguments of the environment, such as '{"n": 3}' (default:
            none).
        options (--options JSON): The options of every reset, as JSON (default: none).
        timeout (--timeout S): Time without an env step after which an environment counts as hung,
            in seconds.
        memory (--memory MB): Memory limit of the environment's process, in MB (default: no limit).
        tolerance (--tolerance X): Largest difference, absolute or relative, at which two numbers
            count as equal (default: they must be identical).
        allow_import (--allow-import): Allow code that only the run names: a file, or a module that
            isn't installed.
        budget (--budget N): Environment steps of the checks; on top, up to half as many (5,000 at
            most) measure the structure, and a quarter shrinks findings.
        quick (--quick): Set the budget to 3,000 steps, which miss rare faults.
        workers (--workers N): Number of worker processes, each with an environment and policies of
            its own for its part of the episodes; the result is the same for any number where
            neither keeps anything from episode to episode (of environments: gamekeeper audit,
            GK604) (default: this process plays all, or with --executor one per core).
        executor (--executor NAME): Executor of the workers: local (processes of this machine), ray
            or ray:ADDRESS (default: local).
        json (--json): Print one JSON document to stdout and everything else to stderr.
        quiet (--quiet, -q): Print no progress and no notes to stderr.
    """


def shared_of_run(
    *, env: str | None, contract: Path | None, budget: Count | None, failed: list[str] | None
) -> None:
    """Declares options that mean something else for a recorded run; it is never called.

    Args:
        env (--env ENV): Environment to open (default: the one that was recorded).
        contract (--contract FILE): Contract to go by (default: the one in the run).
        budget (--budget STEPS): Most env steps that are taken (default: as many as the episodes
            take).
        failed (--failed CONDITION): Condition of a failed episode, such as "return < 0.5" (return:
            the sum of all agents') or "picker_0.return < 0" (default: [failure] of the contract).
    """


def annotations_of(command: Callable[..., Any]) -> dict[str, Any]:
    """Annotations, as typer reads them, of a command's parameters and all shared ones, by name."""
    is_of_run = "run" in inspect.signature(command).parameters
    own = _declared(command)
    of_run = _declared(shared_of_run) if is_of_run else {}
    return {**_declared(shared), **of_run, **own}


@cache
def _declared(function: Callable[..., Any]) -> dict[str, Any]:
    """The annotations of the parameters that the function's docstring describes."""
    kinds, hints = get_type_hints(function), get_type_hints(function, include_extras=True)
    _, _, text = (inspect.getdoc(function) or "").partition("\n\nArgs:\n    ")
    found = {}
    for entry in re.split(r"\n    (?=\S)", text) if text else ():
        name, typed, help = ENTRY.findall(" ".join(entry.split()))[0]
        found[name] = _annotation(kinds[name], typed, help=help, **_settings(hints[name]))
    return found


def _annotation(kind: Any, typed: str, **settings: Any) -> Any:
    words = typed.split()
    names = [word.strip(",") for word in words if word.startswith("-")]
    metavar = " ".join(words[len(names) :]) or None
    if names:
        return Annotated[kind, typer.Option(*names, metavar=metavar, **settings)]
    return Annotated[kind, typer.Argument(metavar=metavar, show_default=False, **settings)]


def hidden(annotation: Any) -> Any:
    """The same option, left out of the help."""
    kind, option = get_args(annotation)
    option = copy(option)
    option.hidden = True
    return Annotated[kind, option]


def _settings(hint: Any) -> dict[str, Any]:
    """The limits or the completion that an `Annotated` has, at any depth of a type."""
    if get_origin(hint) is Annotated:
        settings: Accepted = hint.__metadata__[0]
        return settings._asdict()
    return {key: value for part in get_args(hint) for key, value in _settings(part).items()}


def json_object(text: str | None, *, option: str) -> dict[str, Any]:
    """Returns the object that an option holds as JSON; an empty one where it wasn't given.

    Raises:
        GamekeeperError: it isn't JSON, or isn't an object.
    """
    if text is None:
        return {}
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        value, seen = None, f"{text[:80]!r} ({error})"
    else:
        seen = f"{text[:80]!r}"
    if not isinstance(value, dict):
        raise GamekeeperError(
            f"{option} can't be read",
            where=option,
            expected="a JSON object",
            actual=seen,
            fix=f"""write it in single quotes: {option} '{{"n": 3}}'""",
        )
    return value
