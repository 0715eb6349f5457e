"""What worker processes do with environments: record a rollout, look at a game form.

A task returns plain data. What went wrong on purpose (`GamekeeperError`) is data too; anything
else that is raised here is a fault of ours and comes out as one.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from threading import Event, Thread
from time import monotonic
from typing import Any, Final

from gamekeeper import errors
from gamekeeper.core.space.plain import space_to_json
from gamekeeper.errors import EnvError, GamekeeperError
from gamekeeper.game.converting.slim import described_slim
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.draft import agent_specs, draft_contract, draft_questions
from gamekeeper.game.open import open_env
from gamekeeper.game.opening.construct import foreign_traceback
from gamekeeper.record.recording import rollout

PROGRESS_S: Final = 0.05
"""Seconds between two reports of progress."""
BEAT_S: Final = 0.05
"""Seconds between two signs of life; less than the shortest silence that may be allowed."""

Report = Callable[..., None]


def record_task(
    report: Report,
    *,
    spec: str,
    out: str,
    env_kwargs: Mapping[str, Any],
    policies: Mapping[str, str],
    episodes: int,
    seed: int,
    options: Mapping[str, Any] | None,
    level: str,
    frames: bool,
    most_turns: int | None,
    contract: str | None,
) -> dict[str, Any]:
    """Plays and records episodes, as `rollout` does; reports turns and episodes on the way.

    Returns:
        `{"error": None}`, or the fields of the error that ended it.
    """
    try:
        rollout(
            spec, policies=dict(policies) or "random", episodes=episodes, seed=seed, out=out,
            level=level, contract=contract, options=options, most_turns=most_turns, frames=frames,
            env_kwargs=env_kwargs, after_turn=counter(report, episodes),
            after_episode=lambda done: report(episode=done),
            while_sealing=lambda: signs_of_life(report),
        )  # fmt: skip
    except EnvError as error:
        if error.__cause__ is not None:
            sys.stderr.write(f"{foreign_traceback(error.__cause__)}\n")
        return {"error": error_fields(error)}
    except GamekeeperError as error:
        return {"error": error_fields(error)}
    return {"error": None}


def contract_task(
    report: Report, *, spec: str, env_kwargs: Mapping[str, Any], contract: str | None
) -> dict[str, Any]:
    """Opens an environment and looks at its game form, without a reset or a step.

    Returns:
        `contract` (declared or drafted), `is_declared`, `agents` with their spaces, `questions`,
        `made_of` (its wrappers: which are replaced by `gk.make`, which stay), `policies` (words for
        those of its own); or the fields of the `error` that was in the way.
    """
    try:
        opened = open_env(spec, **env_kwargs)
        try:
            declared = declared_contract(contract, opened)
            form = declared if declared is not None else draft_contract(opened.env)
            specs = agent_specs(opened.env, form)
            questions = draft_questions(opened.env, form)
            made_of = described_slim(opened.env)
            own = getattr(opened.env.unwrapped, "policies", None)
        finally:
            opened.env.close()
    except GamekeeperError as error:
        return {"error": error_fields(error)}
    return {
        "error": None,
        "name": form.name or opened.identity["name"],
        "contract": form.to_json(),
        "is_declared": declared is not None,
        "agents": [
            {
                "name": each.name,
                "observation_space": _space(each.observation_space),
                "action_space": _space(each.action_space),
            }
            for each in specs
        ],
        "questions": [asdict(question) for question in questions],
        "made_of": list(made_of),
        "policies": [str(name) for name in own] if isinstance(own, Mapping) else [],
    }


def error_fields(error: GamekeeperError) -> dict[str, str]:
    """What `error_of` builds the same error from again."""
    parts = {name: getattr(error, name) for name in ("what", "where", "expected", "seen", "mend")}
    return {"kind": type(error).__name__, **parts}


def error_of(fields: Mapping[str, str]) -> GamekeeperError:
    """The error that crossed from a worker process as plain data."""
    kind = getattr(errors, fields["kind"], GamekeeperError)
    parts = {name: fields[name] for name in ("where", "expected", "seen", "mend")}
    error: GamekeeperError = kind(fields["what"], **parts)
    return error


def _space(space: Any) -> dict[str, Any] | None:
    return None if space is None else space_to_json(space)


@contextmanager
def signs_of_life(report: Report) -> Iterator[None]:
    """Gives signs of life while nothing foreign runs: sealing a long run takes its time."""
    is_over = Event()

    def beat() -> None:
        while not is_over.wait(BEAT_S):
            report()

    thread = Thread(target=beat, name="gamekeeper-alive", daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def counter(report: Report, episodes: int) -> Callable[[], None]:
    """Counts turns; reports them now and then, and is a sign of life at each."""
    turns = 0
    last_s = monotonic()
    report(turns=0, episodes=episodes)

    def count() -> None:
        nonlocal turns, last_s
        turns += 1
        now_s = monotonic()
        if now_s - last_s >= PROGRESS_S:
            last_s = now_s
            report(turns=turns)

    return count
