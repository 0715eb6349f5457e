"""From a broken case to a finding: shrunk, and with the program that shows it."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete

from gamekeeper.auditing.agent_places import PLACES
from gamekeeper.auditing.causes import CLASSES, ENTROPY
from gamekeeper.auditing.confirm import Programs
from gamekeeper.auditing.gather import OF_ENTROPY, OF_SHARING, Gathering, look_once
from gamekeeper.auditing.held_programs import has_own_calls, held_still
from gamekeeper.auditing.judge import Judged, verdict_of
from gamekeeper.auditing.probe_session import TimeUpError
from gamekeeper.auditing.snippet import Home, snippet
from gamekeeper.checks.case import Case, Reproducer
from gamekeeper.checks.check import Check
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import plays_repeat
from gamekeeper.checks.verdict import Finding, Verdict
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import shown
from gamekeeper.interface.wrapper_names import wrappers_of
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.reruns import shrink

MOST_TRIES: Final = 48
"""Shorter episodes that are tried for one finding."""
LONGER: Final = 4
"""Factor of turns from a program that passes by chance to the next one."""


@dataclass(slots=True)
class Reproduction:
    """Means of rerunning a case, within a budget of steps of its own.

    Attributes:
        until_s: time of the monotonic clock after which nothing is shrunk; None: no such time.
        rules: file and line of the class of the rules; empty where they aren't known.
    """

    gathering: Gathering
    contract: Contract
    home: Home
    steps_left: int
    until_s: float | None = None
    rules: str = ""

    @property
    def is_spent(self) -> bool:
        """Tells whether nothing more may be rerun."""
        is_late = self.until_s is not None and time.monotonic() > self.until_s
        return is_late or self.steps_left <= 0


def draft_of(judged: Judged, reproduction: Reproduction) -> tuple[Verdict, tuple[Programs, ...]]:
    """The verdict, and the programs of its findings; these are empty where none can run.

    Each failed case that is shown is shrunk.
    """
    check = judged.check
    programs = tuple(_programs(check, case, reproduction) for case in judged.shown)
    verdict = verdict_of(judged, tuple(each.finding for each in programs))
    return verdict, programs if reproduction.home.make else ()


def _programs(check: Check, case: Case, reproduction: Reproduction) -> Programs:
    begun = reproduction.gathering.plays.get((case.where.probe, case.where.play), EpisodePlan())
    play, case = _shortest(check, case, begun, reproduction)
    proof = Reproducer(case.proof) if isinstance(case.proof, str) else case.proof
    expected, actual = words(case.expected), words(case.actual)
    session = reproduction.gathering.session
    is_own = has_own_calls(session.opened.env)
    name = case.where.probe
    holds = [*session.readings_for(name), *[PLACES] * session.by_place]
    if proof is not None and proof.compares:
        holds += [ENTROPY] * (session.holds_entropy and name not in OF_ENTROPY)
        holds += [CLASSES] * (reproduction.gathering.is_shared and name not in OF_SHARING)
    title, shows = f"{check.id}: {check.claim}", f"expected: {expected}\nactual: {actual}"
    place = ", ".join(case.lines) or reproduction.rules
    shows += f"\nenvironment: {place}" if place else ""

    def program(of: EpisodePlan, proof: Reproducer | None) -> str:
        text = snippet(reproduction.home, session.api, of, proof, title=title, shows=shows)
        return reduce(partial(held_still, has_own_calls=is_own), holds, text)

    text = program(play, proof)
    fix = case.fix or check.fix
    finding = Finding(str(case.where), expected, actual, fix, text, case.lines)
    longer = [program(each, proof) for each in longer_episodes(play, begun)]
    unchanged = None if proof is None else unchanged_of(proof)
    return Programs(
        finding,
        tuple(longer),
        compares=proof is not None and proof.compares,
        unchanged=program(begun, unchanged) if unchanged else "",
        wrappers=wrappers_of(session.opened.env),
        plays=proof is None or proof.plays,
        has_own_calls=is_own,
    )


def longer_episodes(play: EpisodePlan, begun: EpisodePlan) -> Iterator[EpisodePlan]:
    """More and more of the episode that was played, at last all of it."""
    if begun.actions is None or play.actions is None:
        yield begun if begun.actions is not None else play
        return
    turns = max(len(play.actions), 1) * LONGER
    while turns < len(begun.actions):
        yield replace(begun, actions=begun.actions[:turns], most_turns=turns)
        turns *= LONGER
    yield begun


def unchanged_of(proof: Reproducer) -> Reproducer | None:
    """The reproducer without its trigger; None where it has none."""
    if not proof.compares or proof.unchanged == "":
        return None
    if proof.unchanged is not None:
        return replace(proof, lines=proof.unchanged)
    return reproducer_of(plays_repeat, options=proof.options)


def _shortest(
    check: Check, case: Case, play: EpisodePlan, reproduction: Reproduction
) -> tuple[EpisodePlan, Case]:
    """The shortest play found that breaks the check in the same field, and where it does."""
    name = case.where.probe
    probe = reproduction.gathering.probes.get(name)
    if probe is None or play.actions is None:
        return play, case
    session = reproduction.gathering.for_probe(name, reproduction.steps_left)
    session.number = case.where.play
    most_tries = MOST_TRIES if probe.tries is None else probe.tries
    tries = 0
    best = play, case

    def still(shorter: EpisodePlan) -> bool:
        nonlocal tries, best
        tries += 1
        if tries > most_tries or reproduction.is_spent:
            return False
        begun, session.meter.until_s = session.meter.steps, reproduction.until_s
        try:
            look = look_once(session, probe, shorter)
        except TimeUpError:
            return False
        finally:
            session.meter.until_s = None
            reproduction.steps_left -= session.meter.steps - begun
        gathered = replace(reproduction.gathering.gathered(), looks={name: (look,)})
        bad = _broken_alike(check, case, reproduction.contract, gathered)
        if bad is not None:
            best = session.base or shorter, bad
        return bad is not None

    turns = case.where.env_steps
    shrink(play, still, turns=turns, plain=_plain(reproduction))
    if best[0] is play and turns is not None:  # nothing was tried, or nothing shorter shows it
        cut = replace(play, actions=play.actions[:turns], most_turns=max(turns, 1))
        return (cut if reproduction.is_spent else play), case
    shorter, bad = best
    shown = bad.where.env_steps
    if shown is not None and shown < len(shorter.actions or ()):
        # with turns left out it shows before the end, where its program looks for it
        cut = replace(shorter, actions=(shorter.actions or ())[:shown], most_turns=max(shown, 1))
        best = (cut, bad) if reproduction.is_spent else best
        tries = 0
        still(cut)
    return best


def _broken_alike(
    check: Check, case: Case, contract: Contract, evidence: ProbeEvidence
) -> Case | None:
    """The first case at which the check is broken in the same field and the same way."""
    try:
        bad = [each for each in check.run(contract, evidence) if not each.ok]
    except Exception:  # a third party's check that can't read so little
        return None
    alike = [
        each
        for each in bad
        if each.where.field == case.where.field
        and each.severity == case.severity
        and (not isinstance(case.expected, str) or each.expected == case.expected)
    ]
    return min(alike, key=lambda each: each.where.turn or 0, default=None)


def _plain(reproduction: Reproduction) -> Mapping[Any, Any]:
    """A simple action for each agent: the declared noop, else 0 or what is next to it."""
    found: dict[Any, Any] = {}
    for agent, spec in reproduction.gathering.session.agents.items():
        space, noop = spec.action_space, spec.noop_action()
        if noop is not None:
            found[agent] = noop
        elif isinstance(space, Discrete):
            found[agent] = int(space.start)
        elif isinstance(space, Box):
            found[agent] = np.clip(0, space.low, space.high).astype(space.dtype)
    return found


def words(value: Any) -> str:
    """A value in words; words as they are."""
    return value if isinstance(value, str) else shown(value)
