"""Arguments and options that several commands share: one meaning, one spelling, one help text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import typer

from gamekeeper.errors import GamekeeperError

EPISODES: Final = 20
SILENCE_S: Final = 60.0
"""Longest time without a turn before an environment counts as hung, in seconds."""
MOST: Final = (1 << 31) - 1
"""Of whatever is counted: evidence numbers episodes and turns with so many bits."""
MOST_SEED: Final = (1 << 62) - 1
"""Of a seed: NumPy's whole numbers hold it, and those that are counted on from it."""
MOST_WORKERS: Final = 4_096
"""Processes of one command."""
MOST_S: Final = 1_000_000.0
"""Eleven days; the system's own waits end at twice that."""

EnvArgument: TypeAlias = Annotated[
    str,
    typer.Argument(
        metavar="ENV",
        show_default=False,
        help="mpe2.simple_spread_v3:parallel_env · path/to/file.py:factory · "
        "butterfly/pistonball-v6 · warehouse; parallel: or aec: in front asks for an API.",
    ),
]
RunArgument: TypeAlias = Annotated[
    Path, typer.Argument(metavar="RUN", show_default=False, help="The folder of recorded evidence.")
]
KwargsOption: TypeAlias = Annotated[
    str | None,
    typer.Option("--kwargs", metavar="JSON", help="""The environment's arguments: '{"n": 3}'."""),
]
ResetOption: TypeAlias = Annotated[
    str | None, typer.Option("--options", metavar="JSON", help="Handed to every reset.")
]
ContractOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--contract",
        metavar="FILE",
        help="Its contract; without it, the one beside the environment's file, if there is one.",
    ),
]
PolicyOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--policy",
        metavar="[AGENT|ROLE=]POLICY",
        help="random (the default), first-legal, noop, reference (where the task has one), "
        "module:callable, file.py:callable. Repeatable.",
    ),
]
EpisodesOption: TypeAlias = Annotated[
    int, typer.Option("--episodes", metavar="N", min=1, max=MOST, help="How many to play.")
]
SeedOption: TypeAlias = Annotated[
    int,
    typer.Option(
        "--seed", metavar="N", min=0, max=MOST_SEED, help="Of the run; settles every episode's."
    ),
]
LevelOption: TypeAlias = Annotated[
    Literal["full", "digest"],
    typer.Option("--level", help="digest: observations as digests only, the same fingerprint."),
]
FramesOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--frames",
        help="Also render once a turn, into RUN/frames; as rgb_array, else ansi, unless --kwargs "
        "names a render_mode.",
    ),
]
TurnsOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--most-turns",
        metavar="N",
        min=1,
        max=MOST,
        help="Cuts longer episodes; otherwise 100,000.",
    ),
]
TimeoutOption: TypeAlias = Annotated[
    float,
    typer.Option(
        "--timeout",
        metavar="S",
        min=0.1,
        max=MOST_S,
        help="Seconds without a turn that count as hung.",
    ),
]
MemoryOption: TypeAlias = Annotated[
    int | None,
    typer.Option("--memory", metavar="MB", min=1, help="Bound of the environment's process."),
]
OutFolderOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FOLDER", help="Where evidence goes; otherwise runs/NAME-1, -2, ..."
    ),
]
OutFileOption: TypeAlias = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="Writes there, not to stdout.")
]
ToleranceOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        metavar="X",
        min=0.0,
        help="Numbers that differ by no more, absolutely or relatively, count as equal.",
    ),
]
JsonOption: TypeAlias = Annotated[
    bool, typer.Option("--json", help="One JSON document on stdout, all else on stderr.")
]
QuietOption: TypeAlias = Annotated[
    bool, typer.Option("--quiet", "-q", help="No progress and no notes on stderr.")
]
ReopenOption: TypeAlias = Annotated[
    str | None,
    typer.Option("--env", metavar="ENV", help="Open this in place of what the evidence names."),
]
ImportOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--allow-import",
        help="Run code that the evidence names: a file, or a module that isn't installed.",
    ),
]
WorkersOption: TypeAlias = Annotated[
    int,
    typer.Option(
        "--workers", metavar="N", min=1, max=MOST_WORKERS, help="Processes that work side by side."
    ),
]


def json_object(text: str | None, *, option: str) -> dict[str, Any]:
    """The object that an option holds as JSON; an empty one where it wasn't given.

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
            seen=seen,
            mend=f"""write it in single quotes: {option} '{{"n": 3}}'""",
        )
    return value
