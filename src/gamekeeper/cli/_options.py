"""Arguments and options that several commands share: one meaning, one spelling, one help text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

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


def workers_option(help: str) -> Any:  # as Typer calls it
    """Option `--workers`, whose meaning `help` says."""
    return typer.Option(
        "--workers", metavar="N", min=1, max=MOST_WORKERS, show_default=False, help=help
    )


def episode_option(help: str) -> Any:  # as Typer calls it
    """Option `--episode`, whose meaning `help` says."""
    return typer.Option("--episode", metavar="N", min=0, max=MOST, help=help)


EnvArgument: TypeAlias = Annotated[
    str,
    typer.Argument(
        metavar="ENV",
        show_default=False,
        autocompletion=_completion.environments,
        help="Environment: warehouse, butterfly/pistonball-v6, path/to/file.py:factory or "
        "mpe2.simple_spread_v3:parallel_env. In front, parallel: or aec: selects the API.",
    ),
]
RunArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="RUN",
        show_default=False,
        autocompletion=_completion.runs,
        help="Folder of a recorded run.",
    ),
]
KwargsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--kwargs",
        metavar="JSON",
        help="""Keyword arguments of the environment, such as '{"n": 3}' (default: none).""",
    ),
]
ResetOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--options", metavar="JSON", help="The options of every reset, as JSON (default: none)."
    ),
]
RunContractOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--contract", metavar="FILE", help="Contract to go by (default: the one in the run)."
    ),
]
ContractOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--contract",
        metavar="FILE",
        help="Contract of the environment (default: the TOML file beside the environment's file, "
        "if there is one).",
    ),
]
PolicyOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--policy",
        metavar="[AGENT|ROLE=]POLICY",
        autocompletion=_completion.policies,
        help="Policy of all agents, an agent or a role: random, first-legal, noop, reference (of "
        "Gamekeeper's own tasks), module:callable or file.py:callable, called as "
        "policy(observation, agent, info, rng) for an action, or same:AGENT to share that agent's "
        "policy object. Repeatable (default: random; of a run, the recorded policies).",
    ),
]
EpisodesOption: TypeAlias = Annotated[
    int,
    typer.Option("--episodes", metavar="N", min=1, max=MOST, help="Number of episodes to play."),
]
SeedOption: TypeAlias = Annotated[
    int,
    typer.Option(
        "--seed",
        metavar="N",
        min=0,
        max=MOST_SEED,
        help="Seed from which the seeds of all episodes are derived.",
    ),
]
LevelOption: TypeAlias = Annotated[
    Literal["full", "digest", "actions"],
    typer.Option(
        "--level",
        help="Content of the run: every value (full), hashes in place of observations (digest), or "
        "seeds, actions, rewards and flags, to be played again by `gamekeeper expand` (actions).",
    ),
]
CheckOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--check/--no-check",
        help="At level actions, replay the first finished episode in a worker meanwhile, and "
        "say at once if it diverges; with several workers, play one of eight or more episodes "
        "again, and say if it depends on those before it.",
    ),
]
FramesOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--frames",
        help="Render every step into RUN/frames, as rgb_array where the environment has it, "
        "else as ansi; a render_mode in --kwargs takes precedence.",
    ),
]
TurnsOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--most-turns",
        metavar="N",
        min=1,
        max=MOST,
        help="Cut an episode after this number of env steps: turns (AEC) or ticks (Parallel) "
        "(default: 100,000).",
    ),
]
StepsOption = Annotated[
    int | None,
    typer.Option(
        "--budget",
        metavar="STEPS",
        min=1,
        max=MOST,
        help="Most env steps that are taken (default: as many as the episodes take).",
    ),
]
TimeoutOption: TypeAlias = Annotated[
    float,
    typer.Option(
        "--timeout",
        metavar="S",
        min=0.1,
        max=MOST_S,
        help="Time without an env step after which an environment counts as hung, in seconds.",
    ),
]
MemoryOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--memory",
        metavar="MB",
        min=1,
        help="Memory limit of the environment's process, in MB (default: no limit).",
    ),
]
OutFolderOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FOLDER",
        help="Folder of the run that is written (default: the first free one of runs/NAME-1, "
        "runs/NAME-2, ...).",
    ),
]
OutFileOption: TypeAlias = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="File to write (default: stdout).")
]
ToleranceOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        metavar="X",
        min=0.0,
        help="Largest difference, absolute or relative, at which two numbers count as equal "
        "(default: they must be identical).",
    ),
]
JsonOption: TypeAlias = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON document to stdout and everything else to stderr."),
]
QuietOption: TypeAlias = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print no progress and no notes to stderr.")
]
ReopenOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--env", metavar="ENV", help="Environment to open (default: the one that was recorded)."
    ),
]
ImportOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--allow-import",
        help="Allow code that only the run names: a file, or a module that isn't installed.",
    ),
]
WorkersOption: TypeAlias = Annotated[
    int,
    typer.Option(
        "--workers", metavar="N", min=1, max=MOST_WORKERS, help="Number of worker processes."
    ),
]


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
