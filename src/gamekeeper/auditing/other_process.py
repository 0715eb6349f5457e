"""An episode once more, in a process of its own under another hash seed."""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.auditing.probe_session import ProbeSession
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import from_json, is_exact, to_json
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.opening import open_env
from gamekeeper.rollouts.episode_loop import (
    EpisodePlan,
    EpisodeResult,
    EvidenceOptions,
    StepHook,
    perform,
)
from gamekeeper.rollouts.process_randomness import held
from gamekeeper.rollouts.warm_worker import WarmWorker
from gamekeeper.rollouts.workers import environment_of

TASK: Final = "gamekeeper.auditing.other_process:play_task"
SILENCE_S: Final = 60.0
HASH_SEEDS: Final = 8
"""Hash seeds that are looked at for one that puts sets of agents' names in another order."""
MOST_HASH_SEEDS: Final = 3
MOST_NAMES: Final = 8
"""Names whose pairs are looked at; of more agents the first."""
ORDERS: Final = "import json, sys; print(json.dumps([[*{*p}] for p in json.loads(sys.argv[1])]))"
"""Prints the order in which a process lists each set of two names."""
HEADER: Final = ("end", "error", "turns", "endings")
ROSTERS: Final = "rosters"
"""Entry of the header of a play elsewhere: `agents` after the reset and after each step."""


def reason_against(session: ProbeSession) -> str | None:
    """Reason why another process can't build the same environment; None where it can."""
    if not isinstance(session.spec, str):
        return "another process can only open an environment that is named by text"
    try:
        json.dumps(dict(session.kwargs))
    except (TypeError, ValueError):
        return "the factory's arguments can't be handed to another process as JSON"
    return None


@cache
def hash_seeds(names: tuple[str, ...]) -> tuple[int, ...]:
    """Hash seeds that together turn the order of any two names in a set, as far as a few do.

    A set's order decides something where two agents compete, whichever two these are.
    """
    pairs = list(combinations(names[:MOST_NAMES], 2))
    left, found = {pair: [*set(pair)] for pair in pairs}, []
    for seed in range(1, HASH_SEEDS + 1):
        there = _orders(pairs, seed) if pairs else []
        turned = {pair for pair, order in zip(pairs, there, strict=True) if left.get(pair) != order}
        turned &= left.keys()
        if 2 * len(turned) >= len(left):
            found.append(seed)
            left = {pair: order for pair, order in left.items() if pair not in turned}
        if not left or len(found) == MOST_HASH_SEEDS:
            break
    return tuple(found) or (1,)


def _orders(pairs: list[tuple[str, str]], hash_seed: int) -> list[list[str]]:
    command = [sys.executable, "-S", "-c", ORDERS, json.dumps(pairs)]
    surroundings = environment_of(hash_seed)
    done = subprocess.run(command, env=surroundings, capture_output=True, check=True)
    orders: list[list[str]] = json.loads(done.stdout)
    return orders


def worker_of(session: ProbeSession, hash_seed: int) -> WarmWorker:
    """The session's worker of that hash seed, started once; it forks for each episode."""
    if hash_seed not in session.workers:
        session.workers[hash_seed] = WarmWorker([__name__], hash_seed=hash_seed)
    return session.workers[hash_seed]


def played_elsewhere(
    session: ProbeSession, base: EpisodeResult, hash_seed: int, *, instance: int = 1
) -> Episode | None:
    """The same episode in a new process, by its nth instance; None where it came to nothing.

    So it does where an action is an object, which no other process has.
    """
    script = _script_of(base.play)
    if not all(is_exact(text) for turn in script["turns"] for _, _, text, _ in turn):
        return None
    session.meter.count(len(base.play.actions or ()))
    with TemporaryDirectory() as folder:
        arguments: dict[str, Any] = {
            "spec": session.spec,
            "kwargs": dict(session.kwargs),
            "contract": session.contract.to_json(),
            "play": script,
            "folder": folder,
            "instances": instance,
        }
        outcome = worker_of(session, hash_seed).run(TASK, arguments, silence_s=SILENCE_S)
        if not isinstance(outcome.value, dict):
            return None
        return replace(
            base.episode,
            header={**base.episode.header, **outcome.value},
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
        rosters: list[list[str]] = []
        with held():
            env = open_env(spec, **kwargs).env
        with held():  # once more, as modules that it imports may draw too
            agents = {_name(agent): agent for agent in getattr(env, "possible_agents", ())}
            again = _from_script(play, agents)
            played = perform(
                again,
                env,
                contract=Contract.from_json(contract),
                keep=EvidenceOptions(number=play["number"]),
                watch=roster_watch(rosters),
                on_step=report,
            )
            with suppress(Exception, SystemExit):  # the episode is what is asked for
                env.close()
    _write(Path(folder, "steps"), played.episode.steps)
    if played.episode.states is not None:
        _write(Path(folder, "states"), played.episode.states)
    return {ROSTERS: rosters, **{name: played.episode.header.get(name) for name in HEADER}}


def roster_watch(rosters: list[list[str]]) -> StepHook:
    """A watch that lists `agents` in their order; of what has no order an empty list."""

    def watch(turn: int, env: Any, out: Any) -> None:
        agents = getattr(env, "agents", None)
        listed = agents if isinstance(agents, list | tuple) else ()
        rosters.append([agent_name(agent) for agent in listed])

    return watch


def _script_of(play: EpisodePlan) -> dict[str, Any]:
    turns = [
        [[*_name(agent), *_text(action)] for agent, action in actions.items()]
        for actions in play.actions or ()
    ]
    return {
        "seed": play.seed,
        "stream": play.stream,
        "most_turns": play.most_turns,
        "turns": turns,
        "number": 0,
    }


def _name(agent: Any) -> tuple[str, str]:
    """Class and name of an agent: the agents 0 and "0" have one name."""
    return type(agent).__name__, agent_name(agent)


def _from_script(script: Mapping[str, Any], agents: Mapping[tuple[str, str], Any]) -> EpisodePlan:
    turns = tuple(
        {agents.get((kind, name), name): _value(*text) for kind, name, *text in actions}
        for actions in script["turns"]
    )
    return EpisodePlan(script["seed"], script["stream"], turns, script["most_turns"])


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
