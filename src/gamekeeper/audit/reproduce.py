"""From a broken occasion to a finding: shrunk, and with the program that shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from gamekeeper.audit.check import Check
from gamekeeper.audit.gather import Gathering, look_once
from gamekeeper.audit.judge import Judged
from gamekeeper.audit.snippet import Home, snippet
from gamekeeper.core.canon import shown
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.proof import Proof
from gamekeeper.core.verdict import Finding, Verdict
from gamekeeper.run.episode import Play, Stopped
from gamekeeper.run.shrink import shrink

MOST_TRIES: Final = 48
"""Shorter plays that are tried for one finding."""


@dataclass(slots=True)
class Bench:
    """What it takes to look again, within a budget of steps of its own."""

    gathering: Gathering
    contract: Contract
    home: Home
    steps_left: int


def verdict_of(judged: Judged, bench: Bench) -> Verdict:
    """The verdict, each broken occasion that is shown shrunk and made a finding."""
    check = judged.check
    findings = tuple(_finding(check, occasion, bench) for occasion in judged.shown)
    return Verdict(
        id=check.id, claim=check.claim, outcome=judged.outcome, severity=check.severity,
        confidence=judged.confidence, occasions=judged.occasions, broken=judged.broken,
        findings=findings, reason=judged.reason,
    )  # fmt: skip


def _finding(check: Check, occasion: Occasion, bench: Bench) -> Finding:
    play = bench.gathering.plays.get((occasion.where.probe, occasion.where.play), Play())
    play, occasion = _shortest(check, occasion, play, bench)
    proof = Proof(occasion.proof) if isinstance(occasion.proof, str) else occasion.proof
    expected, seen = words(occasion.expected), words(occasion.seen)
    program = snippet(
        bench.home, bench.gathering.lab.api, play, proof,
        title=f"{check.id}: {check.claim}", shows=f"expected: {expected}\nseen: {seen}",
    )  # fmt: skip
    return Finding(str(occasion.where), expected, seen, check.mend, program)


def _shortest(check: Check, occasion: Occasion, play: Play, bench: Bench) -> tuple[Play, Occasion]:
    """The shortest play found that breaks the check in the same field, and where it does."""
    name = occasion.where.probe
    probe = bench.gathering.probes.get(name)
    if probe is None or play.actions is None:
        return play, occasion
    lab = bench.gathering.lab.for_probe(name, bench.steps_left)
    lab.number = occasion.where.play
    most_tries = getattr(probe, "TRIES", MOST_TRIES)
    tries = 0
    best = play, occasion

    def still(shorter: Play) -> bool:
        nonlocal tries, best
        tries += 1
        if tries > most_tries or bench.steps_left <= 0:
            return False
        begun = lab.meter.steps
        try:
            look = look_once(lab, probe, shorter)
        except Stopped:
            bench.steps_left = 0
            return False
        finally:
            bench.steps_left -= lab.meter.steps - begun
        bad = _broken_alike(check, occasion, bench.contract, _gathered(bench, name, look))
        if bad is not None:
            best = lab.base or shorter, bad
        return bad is not None

    turns = occasion.where.crossings
    shrink(play, still, turns=turns, plain=_plain(bench))
    if best[0] is play and turns is not None:  # nothing was tried, or nothing shorter shows it
        cut = replace(play, actions=play.actions[:turns], most_turns=max(turns, 1))
        return (cut if bench.steps_left <= 0 else play), occasion
    return best


def _gathered(bench: Bench, probe: str, look: Any) -> Gathered:
    return replace(bench.gathering.gathered(), looks={probe: (look,)})


def _broken_alike(
    check: Check, occasion: Occasion, contract: Contract, evidence: Gathered
) -> Occasion | None:
    """The first occasion at which the check is broken in the same field."""
    try:
        bad = [each for each in check.run(contract, evidence) if not each.ok]
    except Exception:  # a third party's check that can't read so little
        return None
    alike = [each for each in bad if each.where.field == occasion.where.field]
    return min(alike, key=lambda each: each.where.turn or 0, default=None)


def _plain(bench: Bench) -> Mapping[Any, Any]:
    """A simple action for each agent: the declared noop, else 0 where there is one."""
    found: dict[Any, Any] = {}
    for agent, spec in bench.gathering.lab.agents.items():
        space, noop = spec.action_space, spec.noop_action()
        if noop is not None:
            found[agent] = noop
        elif space is not None and type(space).__name__ == "Discrete":
            found[agent] = int(space.start)  # type: ignore[attr-defined]  # a Discrete has one
    return found


def words(value: Any) -> str:
    """A value in words; words as they are."""
    return value if isinstance(value, str) else shown(value)
