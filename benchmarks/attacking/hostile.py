"""Environments that attack whoever records, audits or describes them."""

import json
import os
import time
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks.attacking.attack import ANSWERED, Attack, Found
from gamekeeper.runs.run_check import verify

FILE: Final = Path(__file__).with_name("hostile_env.py")
DAEMON_MARK: Final = "GAMEKEEPER_ATTACK"
TEXTS: Final = ("raises", "raises-base", "raises-exit", "no-text", "huge", "escape", "surrogate")
MEDDLES: Final = (
    "streams-none",
    "streams-closed",
    "streams-replaced",
    "streams-dead",
    "recursion",
    "cwd-gone",
    "chdir",
    "signals",
    "umask",
    "locale",
    "warnings",
    "environ",
    "hooks",
    "path",
    "modules",
    "daemon",
)
AGENTS: Final = ("eq", "hash", "hash-only", "str", "repr", "len", "list")
SPACES: Final = ("tuple", "dict", "recursive-tuple", "recursive-dict", "nonconforming")
GIVEN: Final = ("obs", "reward", "flag", "info", "info-value", "info-key", "mask", "state")
WAYS: Final = ("raises", "raises-base", "attribute", "class", "str", "escape", "surrogate")
RAISED: Final = ("exit", "interrupt", "gen", "recursion", "memory", "stop")


def hostile() -> list[Attack]:
    """Each way in one API, every other in the other one."""
    cases = [("error", way, at) for way in TEXTS for at in ("init", "reset", "step", "close")]
    cases += [("base-error", way, "step") for way in TEXTS]
    cases += [("raise", way, at) for way in RAISED for at in ("init", "step", "close")]
    cases += [
        (what, way, at)
        for what in ("meddle", "meddle-raise")
        for way in MEDDLES
        for at in ("init", "step")
    ]
    cases += [("agent", way, "") for way in AGENTS]
    cases += [(what, way, "") for what in ("space", "action-space") for way in SPACES]
    cases += [(what, way, "") for what in GIVEN for way in WAYS]
    recorded = [_record(*case, api=("ticks", "turns")[n % 2]) for n, case in enumerate(cases)]
    few = [("error", "escape", "step"), ("error", "raises", "step"), ("space", "tuple", "")]
    few += [("metadata", "raises", ""), ("agent", "hash-only", ""), ("meddle", "streams-none", "")]
    return recorded + [_other(words, *case) for words in ("audit", "contract") for case in few]


def _record(what: str, way: str, at: str, *, api: str) -> Attack:
    mark = f"{os.getpid()}-{time.monotonic_ns()}"
    return Attack(
        f"hostile: {what} {way} {at} {api}".replace("  ", " "),
        ("rollout", *_named(what, way, at, api), "--episodes", "1", "--out", "run"),
        out=("run",),
        codes=ANSWERED,
        variables={DAEMON_MARK: mark},
        more=partial(_claims, mark, is_failing=what in ("error", "base-error") and at == "step"),
    )


def _other(command: str, what: str, way: str, at: str) -> Attack:
    words = (command, *_named(what, way, at, "ticks"))
    return Attack(
        f"hostile: {command} of {what} {way} {at}",
        (*words, "--quick") if command == "audit" else words,
    )


def _named(what: str, way: str, at: str, api: str) -> tuple[str, ...]:
    return f"{FILE}:{api}", "--kwargs", json.dumps({"what": what, "way": way, "at": at})


def _claims(mark: str, work: Path, found: Found, *, is_failing: bool) -> dict[str, bool]:
    """Evidence that is there verifies, a failure is one in the evidence, no process is left."""
    run = work / "run"
    claims = {"gone": not _left(mark)}
    if not run.exists():
        return {**claims, "finalized": found.code in (1, 2)}
    status = json.loads((run / "manifest.json").read_bytes())["status"]
    is_right = status == "failed" if is_failing else status in ("finalized", "failed")
    return {**claims, "finalized": is_right and verify(run).ok}


def _left(mark: str) -> list[str]:
    """Processes that have this attack's mark, a moment after its end."""
    wanted = f"{DAEMON_MARK}={mark}".encode()
    found: list[Any] = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if wanted in path.read_bytes().split(b"\0"):
                found.append(path.parent.name)
        except OSError:  # gone meanwhile, or somebody else's
            continue
    return found


KINDS: Final = {"hostile": hostile}
