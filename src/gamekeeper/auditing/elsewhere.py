"""A play once more, in a process of its own under another hash seed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.auditing.probe_session import ProbeSession
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import from_json, to_json
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.opening import open_env
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult, EvidenceOptions, perform
from gamekeeper.rollouts.process_randomness import held
from gamekeeper.rollouts.workers import run_task

TASK: Final = "gamekeeper.auditing.elsewhere:play_task"
ORDER_TASK: Final = "gamekeeper.auditing.set_order:order_task"
SILENCE_S: Final = 60.0
HASH_SEEDS: Final = 8
"""Hash seeds that are tried until one puts a set of the agents' names in another order."""
HEADER: Final = ("end", "error", "turns", "endings")


def reason_against(lab: ProbeSession) -> str | None:
    """Reason why another process can't build the same environment; None where it can."""
    if not isinstance(lab.spec, str):
        return "another process can only open an environment that is named by text"
    try:
        json.dumps(dict(lab.kwargs))
    except (TypeError, ValueError):
        return "the factory's arguments can't be handed to another process as JSON"
    return None


def other_hash_seed(names: list[str], start: int) -> int:
    """The first hash seed from `start` on under which a set of the names begins otherwise."""
    here = next(iter(set(names)), None)
    for seed in range(start, start + HASH_SEEDS):
        if len(set(names)) < 2:
            return seed
        outcome = run_task(ORDER_TASK, {"names": names}, silence_s=SILENCE_S, hash_seed=seed)
        if isinstance(outcome.value, list) and outcome.value[0] != here:
            return seed
    return start


def played_elsewhere(
    lab: ProbeSession, base: EpisodeResult, hash_seed: int, *, instance: int = 1
) -> Episode | None:
    """The same play in a new process; None where that process came to nothing.

    Args:
        instance: which instance of the process plays it, once those before it have.
    """
    lab.meter.count(len(base.play.actions or ()))
    with TemporaryDirectory() as folder:
        arguments: dict[str, Any] = {
            "spec": lab.spec,
            "kwargs": dict(lab.kwargs),
            "contract": lab.contract.to_json(),
            "play": _on_paper(base.play),
            "folder": folder,
            "instances": instance,
        }
        outcome = run_task(TASK, arguments, silence_s=SILENCE_S, hash_seed=hash_seed)
        if not isinstance(outcome.value, dict):
            return None
        return replace(
            base.trace,
            header={**base.trace.header, **outcome.value},
            steps=_read(Path(folder, "steps")),
            states=_read(Path(folder, "states")),
            _cache={},
        )


def play_task(
    report: Callable[..., None],
    *,
    spec: str,
    kwargs: Mapping[str, Any],
    contract: Mapping[str, Any],
    play: Mapping[str, Any],
    folder: str,
    instances: int,
) -> dict[str, Any]:
    """Plays in this process, which was started for it; rows of the last go into `folder`."""
    for _ in range(instances):
        with held():
            env = open_env(spec, **kwargs).env
            agents = {agent_name(agent): agent for agent in getattr(env, "possible_agents", ())}
            again = _from_paper(play, agents)
            played = perform(
                again,
                env,
                contract=Contract.from_json(contract),
                keep=EvidenceOptions(number=play["number"]),
                on_step=report,
            )
            with suppress(Exception, SystemExit):  # the play is what is asked for
                env.close()
    _write(Path(folder, "steps"), played.trace.steps)
    if played.trace.states is not None:
        _write(Path(folder, "states"), played.trace.states)
    return {name: played.trace.header.get(name) for name in HEADER}


def _on_paper(play: EpisodePlan) -> dict[str, Any]:
    turns = [
        [[agent_name(agent), *_text(action)] for agent, action in actions.items()]
        for actions in play.actions or ()
    ]
    return {
        "seed": play.seed,
        "stream": play.stream,
        "most_turns": play.most_turns,
        "turns": turns,
        "number": 0,
    }


def _from_paper(paper: Mapping[str, Any], agents: Mapping[str, Any]) -> EpisodePlan:
    turns = tuple(
        {agents.get(name, name): _value(*text) for name, *text in actions}
        for actions in paper["turns"]
    )
    return EpisodePlan(paper["seed"], paper["stream"], turns, paper["most_turns"])


def _text(action: Any) -> tuple[str, bool]:
    """As canonical JSON, and whether it is a numpy scalar, which that would make a plain one."""
    is_scalar = isinstance(action, np.generic)
    return to_json(np.asarray(action) if is_scalar else action), is_scalar


def _value(text: str, is_scalar: bool) -> Any:
    value = from_json(text)
    return value[()] if is_scalar and isinstance(value, np.ndarray) else value


def _write(path: Path, table: pa.Table) -> None:
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)


def _read(path: Path) -> pa.Table | None:
    if not path.exists():
        return None
    with pa.OSFile(str(path), "rb") as source:
        return pa.ipc.open_file(source).read_all()
