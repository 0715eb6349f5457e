"""The stage of a replay: an environment opened again, in which recorded episodes are played."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from gamekeeper.core.canon import from_json, is_exact
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.where import Where
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.game.faces import game_of
from gamekeeper.game.open import open_env, reopen
from gamekeeper.game.opening.opened import Opened
from gamekeeper.record.course import Course, Look
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
            state=evidence.tables.has("states"),
        )

    def play(
        self,
        header: Mapping[str, Any],
        *,
        cast: Cast | None = None,
        look: Look | None = None,
    ) -> Mapping[str, Any]:
        """The header of an episode, played again: its actions, or those that `cast` chooses.

        Args:
            header: of the recorded episode.
            look: is handed stretches of whole turns, recorded and played, as they come; it says
                whether to play on.
        Raises:
            EvidenceError: an action was an object that no text can build again.
        """
        if cast is None:
            _check_actions(self._evidence, header)
        course = Course(self._evidence.strip(header), self._game, self._sink, look)
        self._game.episode = course.head.episode - 1
        replay_trace(
            course.head,
            self._game,
            agents={seat.name: agent for agent, seat in self._sink.layout.seats.items()},
            types=self._evidence.manifest.get("action_types"),
            cast=cast,
            run_seed=self._evidence.manifest.get("seed"),
            after_turn=self._after_turn,
            turns=course.turns(),
        )
        again = self._kept()
        course.finish(again)
        return next(again.headers)

    def manifest(self) -> Mapping[str, Any]:
        """The manifest of what was played."""
        return self._kept().manifest

    def close(self) -> None:
        """Closes the environment."""
        self._game.close()

    def _kept(self) -> Evidence:
        """What was played since the last call, but for rows that were taken off by then."""
        return self._sink.evidence(self._opened.identity, contract=self._evidence.contract)


def _was_rendered(evidence: Evidence) -> bool:
    """Whether frames were taken: render() may leave traces in what agents see (pistonball's do)."""
    seal = evidence.manifest.get("seal") or {}  # names them even where they were taken away since
    if any(name.startswith("frames/") for name in seal.get("files", ())):
        return True
    return evidence.path is not None and (Path(evidence.path) / "frames").is_dir()


def _check_actions(evidence: Evidence, header: Mapping[str, Any]) -> None:
    """Raises where an action can't be handed over again."""
    columns = ("turn", "agent", "odd")
    for part in evidence.tables.parts("steps", header["episode"], columns=columns) or ():
        for row in part.filter(pc.is_valid(part["odd"])).to_pylist():
            action = json.loads(row["odd"]).get("action", {})
            if "value" in action and not is_exact(compact(action["value"])):
                raise EvidenceError(
                    "an action was an object that no text can build again",
                    where=str(Where("", header["episode"], row["turn"], row["agent"], "action")),
                    seen=compact(action["value"])[:200],
                    mend="act with values of the action space",
                )
