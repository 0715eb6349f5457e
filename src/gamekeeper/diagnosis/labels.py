"""Failure labels on episodes and agents, by a person or by a diagnosis, kept as annotations.

A label says what a failure is called; why an episode ended is said by the rules (an ending's
reason). They are added to a run's annotations, never changed, and no fingerprint covers them.
"""

import getpass
from dataclasses import dataclass
from datetime import UTC, datetime
from difflib import get_close_matches
from os import PathLike
from typing import Any, Final

from gamekeeper.diagnosis.diagnosis_result import Diagnosis
from gamekeeper.diagnosis.plain_data import PlainData
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.errors import EvidenceError
from gamekeeper.runs.files.notes import NOTES, annotate, read_notes
from gamekeeper.runs.load_run import load

KIND: Final = "label"
DIAGNOSIS: Final = "diagnosis"


@dataclass(frozen=True, slots=True)
class Labelled(PlainData):
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
    """Refuses a label of an agent, episode or turn that the run doesn't have."""
    agents = list(map(str, evidence.manifest.get("agents") or ()))
    turns = {row["episode"]: row["turns"] for row in evidence.episode_table.to_pylist()}
    if found.agent is not None and found.agent not in agents:
        raise _no_such("agent", found.agent, f"one of {', '.join(agents)}", "the run has")
    if found.episode is not None and found.episode not in turns:
        raise _no_such("episode", found.episode, f"one of {len(turns)} episodes", "the run has")
    if found.turn is None:
        return
    if found.episode is None:
        raise EvidenceError(
            "a turn needs its episode",
            where="turn",
            expected="an episode beside it",
            actual=f"turn {found.turn} alone",
            fix="name the episode too",
        )
    last = turns[found.episode] or 0
    if not 0 <= found.turn <= last:
        raise _no_such("turn", found.turn, f"from 0 to {last}", f"episode {found.episode} has")


def _no_such(what: str, name: object, expected: str, has: str) -> EvidenceError:
    return EvidenceError(
        f"{has} no {what} {name!r}",
        where=what,
        expected=expected,
        actual=str(name),
        fix=f"name {'a' if what == 'turn' else 'an'} {what} {expected.removeprefix('one of ')}",
    )


def _read(note: dict[str, Any]) -> Labelled:
    text: dict[str, Any] = {
        name: str(note.get(name) or "") for name in ("label", "why", "by", "at")
    }
    place: dict[str, Any] = {name: note.get(name) for name in ("agent", "episode", "turn")}
    for (name, value), kind in zip(place.items(), (str, int, int), strict=True):
        if value is not None and type(value) is not kind:
            raise EvidenceError(
                f"a label's {name} can't be that",
                where=NOTES,
                expected=f"{kind.__name__} or null",
                actual=repr(value)[:100],
                fix="restore the annotations from a copy",
            )
    return Labelled(**text, **place, proposed=bool(note.get("proposed")))


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
