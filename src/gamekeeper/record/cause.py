"""Why a replay diverged: the episode is played a few times more, each in a process of its own."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from gamekeeper.core.divergence import Divergence
from gamekeeper.core.evidence import Evidence
from gamekeeper.record.bundle import load
from gamekeeper.record.stage import Stage, opened_again
from gamekeeper.run.workers import run_task

TASK: Final = "gamekeeper.record.cause:play_task"
IN_MEMORY: Final = ("object", "factory")
GENERATORS: Final = ("random", "numpy.random")


def cause_of(
    evidence: Evidence,
    where: Divergence,
    *,
    env: str | None,
    changed: Mapping[str, Any],
    timeout_s: float | None,
) -> str | None:
    """What the divergence at `where` comes from, as a sentence; None where nothing can be told.

    The diverging episode is played twice under one hash seed, once under another, and once without
    the episodes before it that it needn't run on from.

    Args:
        evidence: the run.
        where: the divergence.
        env: opened in place of the environment that the evidence names.
        changed: versions and sources that aren't those of the recording.
        timeout_s: longest time without a turn.
    """
    header = evidence.header(where.episode)
    since = min(header["since"], where.episode)

    def played(*, first: int, hash_seed: int) -> dict[str, Any] | None:
        arguments = {"path": str(evidence.path), "env": env, "first": first, "last": where.episode}
        outcome = run_task(TASK, arguments, silence_s=timeout_s, hash_seed=hash_seed)
        return outcome.value if isinstance(outcome.value, dict) else None

    one, two = played(first=since, hash_seed=1), played(first=since, hash_seed=1)
    if one is None or two is None:
        return None
    if one["prints"] != two["prints"]:
        return _irreproducible(one["drew"])
    other = played(first=since, hash_seed=2)
    if other is not None and other["prints"] != one["prints"]:
        return (
            "the environment depends on Python's hash seed: it iterates over a set, or calls "
            "hash(), where the order matters; sort it, or set PYTHONHASHSEED for both runs"
        )
    if since:
        after = played(first=0, hash_seed=1)
        if after is not None and after["prints"] != one["prints"]:
            return (
                f"episode {where.episode} depends on what was played before it: the environment "
                "keeps something over a seeded reset"
            )
    return _reproducible(changed, _elsewhere(evidence, env, one))


def _irreproducible(drew: list[str]) -> str:
    what = "the environment isn't reproducible: two replays of the same seed and actions differ"
    if drew:
        names = " and ".join(drew)
        return f"{what}; it draws from the global generator {names}, which its reset doesn't seed"
    return (
        f"{what}; it depends on something outside (a generator that reset doesn't seed, the clock, "
        "addresses, threads)"
    )


def _elsewhere(evidence: Evidence, env: str | None, play: Mapping[str, Any]) -> str | None:
    """Where the environment came from, then and now, where `env` is another than was recorded."""
    then = evidence.manifest["environment"]
    if env is None or then.get("kind") in IN_MEMORY:  # what was in memory has no name to compare
        return None
    one, two = then.get("entry_point"), play.get("entry_point")
    return None if one == two else f"{one} was recorded, {two} replayed"


def _reproducible(changed: Mapping[str, Any], elsewhere: str | None) -> str:
    if elsewhere is not None:
        return (
            "the environment is reproducible, but the one that was named for the replay isn't the "
            f"recorded one: {elsewhere}"
        )
    if changed:
        names = ", ".join("its source" if name == "source" else name for name in changed)
        return f"the environment is reproducible, but it changed since the recording: {names}"
    return (
        "every replay comes out the same, but not as recorded: the recording depended on something "
        "outside it (what was played before, files, the machine)"
    )


def play_task(
    report: Callable[..., None], *, path: str, env: str | None, first: int, last: int
) -> dict[str, Any]:
    """Plays episodes `first` to `last` of a run again.

    Returns:
        `prints`: the fingerprints of the last one; `drew`: the global generators that moved;
        `entry_point`: where the environment came from.
    """
    evidence = load(path)
    opened = opened_again(evidence, env)
    stage = Stage(evidence, opened, after_turn=report)
    before = _global_states()
    header: Mapping[str, Any] = {}
    try:
        for episode in range(first, last + 1):
            header = stage.play(evidence.header(episode))
    finally:
        stage.close()
    moved = [a != b for a, b in zip(before, _global_states(), strict=True)]
    return {
        "prints": [header.get("fingerprint"), header.get("info_fingerprint")],
        "drew": [name for name, has_moved in zip(GENERATORS, moved, strict=True) if has_moved],
        "entry_point": opened.identity.get("entry_point"),
    }


def _global_states() -> tuple[object, object]:
    """The states of the global generators, in the order of `GENERATORS`."""
    return repr(random.getstate()), repr(np.random.get_state(legacy=True))
