"""Failure labels on episodes and agents, by a person or by a diagnosis, kept as annotations.

A label says what a failure is called; why an episode ended is said by the rules (an ending's
reason). They are added to a run's annotations, never changed, and no fingerprint covers them.
"""

from __future__ import annotations

import getpass
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from difflib import get_close_matches
from os import PathLike
from typing import Any, Final

from gamekeeper.diagnosis.diagnosis_result import Diagnosis
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.errors import EvidenceError
from gamekeeper.runs.files.notes import NOTES, annotate, read_notes
from gamekeeper.runs.load_run import load

KIND: Final = "label"
DIAGNOSIS: Final = "diagnosis"


@dataclass(frozen=True, slots=True)
class Labelled:
    """A failure label.

    Attributes:
        label: one of the seven.
        agent: whose failure; None: the team's.
        episode, turn: where; None: of the whole run, of the whole episode.
        why: the reason, as it was given.
        by: who says so: a person's name, or `gamekeeper diagnose`.
        at: when, in UTC.
        proposed: it comes from a diagnosis, and no person has said it.
    """

    label: str
    agent: str | None
    episode: int | None
    turn: int | None
    why: str
    by: str
    at: str
    proposed: bool

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {name: getattr(self, name) for name in self.__slots__}


def label(
    run: str | PathLike[str],
    name: str,
    *,
    agent: str | None = None,
    episode: int | None = None,
    turn: int | None = None,
    why: str = "",
    by: str | None = None,
) -> Labelled:
    """Adds a failure label to a run's annotations.

    Args:
        run: the folder of the run.
        name: one of the seven labels; a hyphen stands for a blank.
        agent: whose failure; None: the team's.
        episode: in which; None: in all.
        turn: at which.
        why: the reason.
        by: who says so; None: this system's user.
    Raises:
        EvidenceError: there is no such label, agent, episode or turn.
        RunError: there is no run, or its annotations can't be written.
    """
    evidence = load(run)
    found = Labelled(
        _known(name), agent, episode, turn, why, by or getpass.getuser(), _now(), proposed=False
    )
    _check(evidence, found)
    annotate(run, {"kind": KIND, **found.to_json()})
    return found


def labels(
    run: str | PathLike[str],
    *,
    name: str | None = None,
    agent: str | None = None,
    episode: int | None = None,
) -> tuple[Labelled, ...]:
    """The labels of a run, in the order in which they were given.

    Args:
        run: the folder of the run.
        name, agent, episode: only those; None: all.
    Raises:
        RunError: there is no run, or its annotations are damaged.
    """
    wanted = None if name is None else _known(name)
    return tuple(
        each
        for note in read_notes(run)
        if note.get("kind") == KIND
        for each in [_read(note)]
        if wanted in (None, each.label)
        and agent in (None, each.agent)
        and episode in (None, each.episode)
    )


def propose(run: str | PathLike[str], diagnosis: Diagnosis, *, by: str) -> tuple[Labelled, ...]:
    """Adds what a diagnosis came to, and a proposed label for each cause that it isolated.

    What stands there already isn't said twice.
    """
    known = [note for note in read_notes(run) if note.get("kind") in (KIND, DIAGNOSIS)]
    document = {"kind": DIAGNOSIS, "by": by, "document": diagnosis.to_json()}
    if any(note.get("document") == document["document"] for note in known):
        return ()
    annotate(run, {**document, "at": _now()})
    found = tuple(
        Labelled(each, agent, None, None, one.why, by, _now(), proposed=True)
        for agent, one in diagnosis.agents.items()
        if one.answer in ("isolated", "joint")
        for each in one.labels
    )
    for one in found:
        annotate(run, {"kind": KIND, **one.to_json()})
    return found


def _known(name: str) -> str:
    label = name.strip().lower().replace("-", " ").replace("_", " ")
    if label in LABELS:
        return label
    near = get_close_matches(label, LABELS, 1)
    raise EvidenceError(
        f"there is no failure label {name!r}",
        where="label",
        expected=", ".join(LABELS),
        actual=name,
        fix=f"write '{near[0]}'"
        if near
        else "take one of the seven; how an episode ended is no label",
    )


def _check(evidence: Evidence, found: Labelled) -> None:
    agents: Sequence[Any] = evidence.manifest.get("agents") or ()
    if found.agent is not None and found.agent not in map(str, agents):
        raise EvidenceError(
            f"the run has no agent {found.agent!r}",
            where="agent",
            expected=f"one of {', '.join(map(str, agents))}",
            actual=found.agent,
            fix="name an agent of the run",
        )
    header = None if found.episode is None else evidence.header(found.episode)
    if found.turn is None:
        return
    if header is None:
        raise EvidenceError(
            "a turn needs its episode",
            where="turn",
            expected="an episode beside it",
            actual=f"turn {found.turn} alone",
            fix="name the episode too",
        )
    last = header["turns"] or 0
    if not 0 <= found.turn <= last:
        raise EvidenceError(
            f"episode {found.episode} has no turn {found.turn}",
            where="turn",
            expected=f"0 to {last}",
            actual=str(found.turn),
            fix=f"name a turn from 0 to {last}, or another episode",
        )


def _read(note: dict[str, Any]) -> Labelled:
    text = {name: str(note.get(name) or "") for name in ("label", "why", "by", "at")}
    for name, kind in (("agent", str), ("episode", int), ("turn", int)):
        value = note.get(name)
        if value is not None and type(value) is not kind:
            raise EvidenceError(
                f"a label's {name} can't be that",
                where=NOTES,
                expected=f"{kind.__name__} or null",
                actual=repr(value)[:100],
                fix="restore the annotations from a copy",
            )
    return Labelled(
        text["label"],
        note.get("agent"),
        note.get("episode"),
        note.get("turn"),
        text["why"],
        text["by"],
        text["at"],
        bool(note.get("proposed")),
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
