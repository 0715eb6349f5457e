"""Command lines, played in this process: damaged ones, and sound ones over damaged evidence."""

import contextlib
import io
import json
import os
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.fuzzing.damage import WORDS, damaged
from gamekeeper.cli._app import run_line
from gamekeeper.errors import GamekeeperError

FAULT: Final = "fault of gamekeeper"
"""What a command says where an exception came out that is none of the house."""
READING: Final = (
    "show RUN",
    "show RUN --json",
    "show RUN --quiet",
    "verify RUN",
    "verify RUN --json",
    "diff RUN SOUND",
    "diff SOUND RUN --json",
    "label RUN",
    "label RUN --json",
    "report RUN --out OUT.html",
    "export RUN --to numpy --out OUT.npz",
    "query RUN VIEWS",
    "query RUN STEPS",
    "query RUN LABELS --json",
    "recover RUN",
)
"""Commands that only read a run, or write beside it; nothing of them opens an environment."""
SQL: Final = {
    "VIEWS": "SELECT * FROM returns, endings, runs, agents LIMIT 9",
    "STEPS": "SELECT agent, sum(reward) FROM agent_steps GROUP BY agent",
    "LABELS": "SELECT * FROM labels, episodes LIMIT 9",
}
LINES: Final = (
    *READING,
    "show RUN --seed 3 --quiet",
    "explain GK402",
    "explain GK999 --json",
    "list checks --json",
    "list envs",
    "verify RUN --fingerprint abc",
    "replay RUN --tolerance nan",
    "replay NOWHERE --env nothing.here:env",
    "contract nothing.here:env --kwargs {}",
    "run no/such.py:env --episodes 0",
    "record nowhere --kwargs [1] --out OUT --policy random",
    "audit nothing.here:env --select GK4 --ignore GK402 --budget 10 --json",
    "evaluate nowhere.toml --json --workers 1",
    "diagnose NOWHERE --json",
    "attribute NOWHERE",
    "label RUN exploration --episode 0 --why x",
    "view NOWHERE --port 70000",
    "video NOWHERE --episode 0 --out OUT.mp4",
    "export RUN --to minari --out OUT",
    "new x --api parallel --out OUT",
    "query RUN SELECT --out OUT.csv",
    "--version",
    "--help",
)
OPENING: Final = frozenset({"contract", "run", "rollout", "audit", "replay", "evaluate", "new"})
"""Commands that would open a real environment, or write: their first argument stays as it is."""


def damaged_line(rng: random.Random) -> list[str]:
    """A line with arguments changed, left out, doubled or taken from another line."""
    line = rng.choice(LINES).split(" ")
    for _ in range(rng.choice((1, 1, 2, 3))):
        first = 2 if line[0] in OPENING else 1
        place = rng.randrange(min(first, len(line)), len(line) + 1)
        kind = rng.randrange(6)
        if kind == 0 and place < len(line):
            del line[place]
        elif kind == 1 and place < len(line):
            line.insert(place, line[place])
        elif kind == 2:
            line.insert(place, _argument(rng.choice(WORDS)[:2000]))
        elif kind == 3:
            other = rng.choice(LINES).split(" ")
            line.insert(place, rng.choice(other[2:] or ["--json"]))
        elif place < len(line):
            data = line[place].encode(errors="surrogatepass")
            line[place] = _argument(damaged(data, [b"--json", b"{}"], rng))
    return line


def _argument(data: bytes) -> str:
    """Bytes as a shell hands them on: without a zero, what is no UTF-8 as surrogates."""
    return os.fsdecode(data.replace(b"\0", b""))


def play(line: Sequence[str], *, run: Path, sound: Path, out: Path) -> None:
    """Plays a line; a refusal is raised as the error that it is, a fault as what it is.

    Raises:
        GamekeeperError: the line was refused.
        RuntimeError: the command met an exception that is none of the house.
    """
    names = {"RUN": str(run), "SOUND": str(sound), "NOWHERE": str(run / "nowhere"), **SQL}
    whole = [names.get(word, word) for word in line]
    whole = [str(out / word) if word.startswith("OUT") else word for word in whole]
    said, failed = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(failed):
        code = run_line(whole)
    if FAULT in failed.getvalue():
        raise RuntimeError(failed.getvalue()[-1500:])
    if code not in (0, 1, 2):
        raise RuntimeError(f"exit code {code}")
    options = line[: line.index("--")] if "--" in line else line  # after it: arguments
    if "--json" in options and "--help" not in options and said.getvalue().strip():
        json.loads(said.getvalue())
    if code:
        raise GamekeeperError("refused")
