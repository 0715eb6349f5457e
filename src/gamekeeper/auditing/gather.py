"""Gathering: the probes at work within a budget of environment steps."""

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final

from gamekeeper.auditing.agent_places import are_found_by_place
from gamekeeper.auditing.class_state import ClassState
from gamekeeper.auditing.draw_holds import hold_entropy
from gamekeeper.auditing.evidence_memory import EVIDENCE_BYTES, held_bytes, most_turns, slimmed
from gamekeeper.auditing.probe import Probe, probes
from gamekeeper.auditing.probe_session import LEAST_TURNS, Meter, ProbeSession, TimeUpError
from gamekeeper.auditing.readings import AS_IT_IS, readings_of
from gamekeeper.checks.facts.episode_facts import RaisedCall
from gamekeeper.checks.paired_episodes import differs_by_itself
from gamekeeper.checks.probe_evidence import (
    Fact,
    ProbeCounterfactual,
    ProbeDeath,
    ProbeEvidence,
    ProbeRun,
)
from gamekeeper.contract import Contract
from gamekeeper.episodes.exception_text import traceback_text
from gamekeeper.episodes.outcome import check_measured, outcome_of
from gamekeeper.interface.contract_draft import agent_specs
from gamekeeper.interface.opening import Opened
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.process_randomness import held

INTERRUPTED: Final = "the audit was interrupted"
TIME_UP: Final = "the audit's time was over"
DIED: Final = "the environment's process ended again and again"
MOST_DEATHS: Final = 6
"""Probes in which the process may end; after one more, no other probe looks."""
BLIND: Final = "no step gave an observation or a reward (see what failed)"
ROLLOUT: Final = "rollout"
"""The probe that plays whole episodes."""
FIRST: Final = "same_seed"
"""The probe that tells whether episodes differ by themselves; it looks before all others."""
EARLY: Final = (
    *(FIRST, "surface", "spaces", "metadata", "rollout", "lifecycle", "kept", "books"),
    *("unseeded", "written", "state", "special_seeds", "extra_calls"),
)
"""Probes of many checks, or of few steps: what ends the time of an audit costs the others."""
LAST: Final = "second_episode"
"""The probe that plays again what another one saw differ in a used instance."""
OF_ENTROPY: Final = frozenset({FIRST, "special_seeds", "unseeded", "other_process"})
"""Probes that look for draws that no seed determines."""
OF_SHARING: Final = frozenset(
    {FIRST, "unseeded", "other_process", "second_episode", "alternated", "lifecycle"}
)
"""Probes that look for what plays share, or that depend on the order of episodes."""
WARM_PART: Final = 0.05
"""Part of the time within which the first play has to end, for another one to be timed."""
FEW_TURNS: Final = 8
"""A play takes so many, however little time there is."""


@dataclass(slots=True)
class Gathering:
    """Evidence of all probes, with what it takes to rerun them.

    Attributes:
        session: of the audit; a probe's own is made from it.
        plays: by probe and number, what was played.
        not_exercised: probes that couldn't look, and why.
        broken: probes that failed through a fault of their own, with the traceback.
        stopped: what ended the gathering before all probes had looked; empty where nothing did.
        cut: probes that ended before they had seen all that their ration allows.
        class_state: what the classes kept before the first episode.
        is_shared: plays differ by that alone, so that it is held still for other probes.
        is_read: whether the environment has to be read otherwise was looked at.
        share_until_s: time of the monotonic clock at which the share of the probe at work ends; its
            first look may take longer, as less than that shows nothing.
        is_short: the time allows fewer steps than were asked for.
    """

    session: ProbeSession
    probes: Mapping[str, Probe]
    looks: dict[str, list[ProbeRun]] = field(default_factory=dict)
    plays: dict[tuple[str, int], EpisodePlan] = field(default_factory=dict)
    not_exercised: dict[str, str] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    stopped: str = ""
    cut: list[str] = field(default_factory=list)
    class_state: ClassState | None = None
    is_shared: bool = False
    is_read: bool = False
    share_until_s: float | None = None
    is_short: bool = False

    def for_probe(self, name: str, ration: int) -> ProbeSession:
        """The session of a probe, with what is held still for it."""
        session = self.session.for_probe(name, ration)
        if self.is_shared and name not in OF_SHARING:
            session.class_state = self.class_state
        return session

    def gathered(self) -> ProbeEvidence:
        """For the checks to read."""
        meter = self.session.meter
        return ProbeEvidence(
            api=self.session.api,
            agents=self.session.agents,
            looks={probe: tuple(looks) for probe, looks in self.looks.items()},
            not_exercised=self.not_exercised,
            blind=BLIND if meter.has_played and not meter.has_seen else "",
        )


def session_of(
    opened: Opened,
    contract: Contract | None,
    *,
    spec: object,
    kwargs: Mapping[str, Any],
    seed: int,
    budget: int,
    beat: Callable[[], None] | None = None,
) -> ProbeSession:
    """The session for an environment that is open and wasn't reset yet."""
    declared = contract or Contract()
    agents = {each.name: each for each in agent_specs(opened.env, declared)}
    return ProbeSession(
        probe="",
        opened=opened,
        spec=spec,
        kwargs=kwargs,
        api=opened.api,
        contract=declared,
        agents=agents,
        seed=seed + 1,
        ration=budget,
        meter=Meter(beat=beat),
        by_place=are_found_by_place(opened),
    )


def gather(
    session: ProbeSession,
    names: Collection[str],
    *,
    died: Mapping[str, str],
    on_probe: Callable[[str, int, int], None],
    until_s: float | None = None,
    keeps_partial: bool = False,
) -> Gathering:
    """Lets the probes of these names look, one after the other, each within its ration.

    Args:
        session: its ration is that of all together.
        died: probes in which the process of an earlier try died or hung, and what was said of it;
            they don't look again.
        on_probe: called with a probe's name, its place and their number, before it looks.
        until_s: time of the monotonic clock at which all must be over; each probe has its share of
            what is left when it begins, and one look at least; it goes on where that was too little
            and time is left at the end, within half of it.
        keeps_partial: Ctrl-C ends the gathering, and isn't raised.
    """
    found = probes(names)
    gathering = Gathering(session, found, class_state=ClassState(session.opened.env))
    total = sum(probe.share for probe in found.values()) or 1.0
    parts = {name: probe.share / total + probe.on_top for name, probe in found.items()}
    left = sum(parts.values())
    if len(died) > MOST_DEATHS:
        gathering.stopped = DIED
    elif until_s is not None and not died:
        on_probe(in_order(found, is_short=False)[0], 0, len(found))  # it plays, and may die of it
        steps = int(_steps_until(session, until_s) / left)
        gathering.is_short = steps < session.ration
        session.ration = min(session.ration, steps)
    order = in_order(found, is_short=gathering.is_short)
    for names in (order, gathering.cut):  # those that are cut look once more in what is left
        if names is not order:
            left = sum(parts[name] for name in names)
            if until_s is not None:  # the other half is for reproducers
                until_s = (time.monotonic() + until_s) / 2
        for name in list(names):
            if gathering.stopped and name not in died:
                gathering.not_exercised.setdefault(name, gathering.stopped)
                continue
            on_probe(name, order.index(name), len(found))
            if until_s is not None:
                now_s, session.meter.until_s = time.monotonic(), until_s
                share_s = max(until_s - now_s, 0.0) * parts[name] / left
                gathering.share_until_s = now_s + share_s
            try:
                _turn_of(gathering, name, parts[name], died)
            except KeyboardInterrupt:
                if not keeps_partial:
                    raise
                gathering.stopped = INTERRUPTED
                gathering.not_exercised[name] = gathering.stopped
            session.meter.until_s = None
            left -= parts[name]
    if gathering.cut and not gathering.stopped:
        gathering.stopped = TIME_UP
    if not gathering.stopped:
        _add_raised(gathering)
    return gathering


def in_order(found: Mapping[str, Probe], *, is_short: bool) -> list[str]:
    """The probes' names: early ones, all others, those on top of the budget, the last one.

    Where time is short the last one, which would have no turn, comes once used instances were seen.
    """
    early = {name: place for place, name in enumerate(EARLY)}
    if is_short:
        early[LAST] = early["kept"]
    return sorted(
        found,
        key=lambda name: (
            name == LAST and not is_short,
            early.get(name, len(early)),
            found[name].on_top > 0,
            name == LAST,
        ),
    )


def _add_raised(gathering: Gathering) -> None:
    """Adds to the rollouts the episode that another probe saw raise, where they saw none."""
    session, looks = gathering.session, gathering.looks.get(ROLLOUT)
    if not looks or not session.raised or any(look.fact(RaisedCall) for look in looks):
        return
    rollout = gathering.for_probe(ROLLOUT, 0)
    rollout.number = len(looks)
    look = look_once(rollout, gathering.probes[ROLLOUT], session.raised[0])
    if look.fact(RaisedCall):
        looks.append(look)
        gathering.plays[ROLLOUT, rollout.number] = rollout.base or session.raised[0]


def _turn_of(gathering: Gathering, name: str, part: float, died: Mapping[str, str]) -> None:
    """Lets a probe look, if it can; what its time cuts off stands in `cut`."""
    session, probe = gathering.session, gathering.probes[name]
    if name in died:
        where = session.for_probe(name, 0).at()
        gathering.looks[name] = [ProbeRun(facts=(Fact(where, ProbeDeath(died[name])),))]
        gathering.not_exercised[name] = f"the environment's process {died[name]}"
        return
    reason = probe.reason_against(session)
    if reason is not None:
        gathering.not_exercised[name] = reason
        return
    begun_s = time.perf_counter()
    if name in gathering.cut:
        gathering.cut.remove(name)
    gathering.looks.setdefault(name, [])
    try:
        session.meter.count(0)
        rations = int(session.ration * part), int(EVIDENCE_BYTES * part)
        _probe(gathering, name, probe, *rations)
        if not gathering.is_read and name not in AS_IT_IS and _has_readings(gathering):
            gathering.looks[name] = []
            _probe(gathering, name, probe, *rations)
        gathering.not_exercised.pop(name, None)
    except TimeUpError:
        gathering.not_exercised[name] = TIME_UP
        gathering.cut.append(name)
    spent_s = time.perf_counter() - begun_s
    gathering.seconds[name] = gathering.seconds.get(name, 0.0) + spent_s
    if name == ROLLOUT:
        _check_measured(gathering)
    if name == FIRST:
        session.holds_entropy = differs_by_itself(gathering.gathered())
        with suppress(TimeUpError):  # too little time to tell
            gathering.is_shared = session.holds_entropy and _is_shared(gathering)


def _has_readings(gathering: Gathering) -> bool:
    """Tells whether plays show more through readings, with which all go on then."""
    session, gathering.is_read = gathering.session, True
    if session.meter.has_begun and session.meter.has_seen:
        return False
    session.readings = readings_of(session.opened, session.seed)
    if session.readings:
        env = session.make()
        session.agents = {each.name: each for each in agent_specs(env, session.contract)}
        session.close()
    return bool(session.readings)


def _is_shared(gathering: Gathering) -> bool:
    """Tells whether plays are alike once what the classes keep is put back before each."""
    play = gathering.plays.get((FIRST, 0))
    if play is None or gathering.class_state is None:
        return False
    session = replace(gathering.session, class_state=gathering.class_state)
    with held():
        one, two = (session.play(play, state=False) for _ in range(2))
    session.close()
    return session.divergence(one.episode, two.episode) is None


def _steps_until(session: ProbeSession, until_s: float) -> int:
    """Steps that fit into the time left, as fast as the first ones of an instance are.

    The first play of all imports and compiles, too: another one is timed where there is time.
    """
    begun_s = time.monotonic()
    step_s = _seconds_of_step(session)
    if time.monotonic() - begun_s < (until_s - begun_s) * WARM_PART:
        step_s = min(step_s, _seconds_of_step(session))
    return max(int((until_s - time.monotonic()) / step_s), 1)


def _seconds_of_step(session: ProbeSession) -> float:
    begun_s, begun = time.monotonic(), session.meter.steps
    session.play(EpisodePlan(seed=session.seed, most_turns=LEAST_TURNS), state=False)
    session.base = None
    session.close()
    return (time.monotonic() - begun_s) / max(session.meter.steps - begun, 1)


def _check_measured(gathering: Gathering) -> None:
    """Checks the failure conditions against the first episode that ended by itself.

    Raises:
        ContractError: a condition asks for what nothing measures.
    """
    contract = gathering.session.contract
    episodes = [episode for look in gathering.looks[ROLLOUT] for episode in look.episodes]
    ended = next((episode for episode in episodes if episode.header.get("end") == "ended"), None)
    if ended is not None and contract.failure:
        check_measured(outcome_of(ended), contract.failure, contract)


def look_once(session: ProbeSession, probe: Probe, play: EpisodePlan) -> ProbeRun:
    """Result of one rerun of a probe; its instances are closed.

    The global generators start from one seed, so that equal audits see the same.
    """
    session.base = None
    is_held = session.holds_entropy and probe.name not in OF_ENTROPY
    with held(), ExitStack() as put_back:
        if is_held:
            put_back.callback(hold_entropy())
        try:
            saw = list(probe.look(session, play))
        finally:
            session.close()
    return ProbeRun(
        episodes=tuple(each for each in saw if not isinstance(each, Fact | ProbeCounterfactual)),
        counterfactuals=tuple(
            slimmed(each) for each in saw if isinstance(each, ProbeCounterfactual)
        ),
        facts=tuple(each for each in saw if isinstance(each, Fact)),
    )


def _probe(gathering: Gathering, name: str, probe: Probe, ration: int, size_bytes: int) -> None:
    session = gathering.for_probe(name, ration)
    longest, held = most_turns(session, size_bytes), 0
    if gathering.is_short:
        longest = min(longest, max(ration, FEW_TURNS))
    looks = gathering.looks[name]
    begun, before = session.meter.steps, len(looks)
    try:
        for number, play in enumerate(probe.plays(session)):
            if number < before:  # it goes on where its time was over
                continue
            if number:
                session.meter.until_s = gathering.share_until_s
            if number > before and (session.meter.steps - begun >= ration or held >= size_bytes):
                break
            session.number = number
            play = replace(play, most_turns=min(play.most_turns, longest))
            looks.append(look_once(session, probe, play))
            held += held_bytes(looks[-1])
            gathering.plays[name, number] = session.base or play
    except (KeyboardInterrupt, TimeUpError):
        raise
    except BaseException as error:  # a fault of the probe's, told as one; the other probes go on
        gathering.broken[name] = traceback_text(error)
