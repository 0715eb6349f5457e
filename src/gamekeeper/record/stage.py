"""The stage of a replay: an environment opened again, in which recorded episodes are played."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gamekeeper.core.canon import from_json, is_exact
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.trace import Trace
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.game.faces import game_of
from gamekeeper.game.open import open_env, reopen
from gamekeeper.game.opening.opened import Opened
from gamekeeper.run.memory import MemorySink
from gamekeeper.run.play import Cast
from gamekeeper.run.rerun import replay_trace


def opened_again(evidence: Evidence, env: str | None) -> Opened:
    """The environment that evidence names, or `env` in its place with the recorded arguments.

    Raises:
        SpecError: it can't be opened.
    """
    identity = evidence.manifest["environment"]
    if env is None:
        return reopen(identity)
    kwargs: Any = from_json(compact(identity.get("kwargs") or {}))
    return open_env(env, api=identity.get("api"), **kwargs)


def check_named(env: object) -> None:
    """Raises where `env`, which a process of its own has to open, is neither a text nor None.

    Raises:
        SpecError: it is an object or a callable.
    """
    if env is None or isinstance(env, str):
        return
    raise SpecError(
        "a recorded run is played again in a process of its own, which opens the environment by "
        "its name",
        where="env",
        expected="a text: an id, 'module:factory' or 'path/to/file.py:factory'",
        seen=f"{type(env).__module__}.{type(env).__qualname__}",
        mend="name where it is made; or record the object a second time with gk.record, and "
        "compare both runs with gk.diff",
    )


def compact(plain: object) -> str:
    """Plain JSON that was canonical text once, as that text."""
    return json.dumps(plain, separators=(",", ":"), ensure_ascii=False)


class _Unkept(MemorySink):
    """Lets frames go: that they are rendered is what matters."""

    __slots__ = ()

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Drops a frame."""


class Stage:
    """Plays recorded episodes again in one environment, one after the other."""

    def __init__(
        self, evidence: Evidence, opened: Opened, *, after_turn: Callable[[], None] | None = None
    ) -> None:
        """Sets up `opened` as it was set up for `evidence`."""
        self._evidence, self._opened, self._after_turn = evidence, opened, after_turn
        self._sink = _Unkept(
            terms=tuple(evidence.manifest.get("terms") or ()),
            volatile=evidence.contract.volatile_infos(),
        )
        self._game = game_of(
            opened.env,
            sink=self._sink,
            frames=_was_rendered(evidence),
            state=evidence.tables.table("states") is not None,
        )

    def play(self, trace: Trace, cast: Cast | None = None) -> Trace:
        """What became of an episode, played again: its actions, or those that `cast` chooses.

        Raises:
            EvidenceError: an action was an object that no text can build again.
        """
        if cast is None:
            _check_actions(trace)
        self._game.episode = trace.episode - 1
        replay_trace(
            trace,
            self._game,
            agents={seat.name: agent for agent, seat in self._sink.layout.seats.items()},
            types=self._evidence.manifest.get("action_types"),
            cast=cast,
            run_seed=self._evidence.manifest.get("seed"),
            after_turn=self._after_turn,
        )
        return next(self._kept().traces)

    def manifest(self) -> Mapping[str, Any]:
        """The manifest of what was played."""
        return self._kept().manifest

    def close(self) -> None:
        """Closes the environment."""
        self._game.close()

    def _kept(self) -> Evidence:
        return self._sink.evidence(self._opened.identity, contract=self._evidence.contract)


def _was_rendered(evidence: Evidence) -> bool:
    """Whether frames were taken: render() may leave traces in what agents see (pistonball's do)."""
    seal = evidence.manifest.get("seal") or {}  # names them even where they were taken away since
    if any(name.startswith("frames/") for name in seal.get("files", ())):
        return True
    return evidence.path is not None and (Path(evidence.path) / "frames").is_dir()


def _check_actions(trace: Trace) -> None:
    """Raises where an action can't be handed over again."""
    for turn, agent, odd in zip(
        *(trace.steps[name].to_pylist() for name in ("turn", "agent", "odd")), strict=True
    ):
        action = {} if odd is None else json.loads(odd).get("action", {})
        if "value" in action and not is_exact(compact(action["value"])):
            raise EvidenceError(
                "an action was an object that no text can build again",
                where=str(trace.at(turn, agent, "action")),
                seen=compact(action["value"])[:200],
                mend="act with values of the action space",
            )
