"""Gathering: the probes at work within a budget of environment steps."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from gamekeeper import plugins
from gamekeeper.audit.bulk import EVIDENCE_BYTES, held_bytes, most_turns, slimmed
from gamekeeper.audit.lab import Lab, Meter, Probe
from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Gathered, Look, Twin
from gamekeeper.errors import EvidenceError
from gamekeeper.game.draft import agent_specs
from gamekeeper.game.open import Opened
from gamekeeper.run.episode import Play, Stopped

GROUP: Final = "gamekeeper.probes"
PACKAGE: Final = "gamekeeper.audit.probes"

DIED: Final = "died"
"""The fact of a probe whose process died or hung."""


@dataclass(slots=True)
class Gathering:
    """What was gathered, with what it takes to look again.

    Attributes:
        lab: the bench; a probe's own is made from it.
        looks: by probe.
        plays: by probe and number, what was played.
        unseen: probes that couldn't look, and why.
        broken: probes that failed through a fault of their own, with the traceback.
        seconds: by probe.
    """

    lab: Lab
    probes: Mapping[str, Probe]
    looks: dict[str, list[Look]] = field(default_factory=dict)
    plays: dict[tuple[str, int], Play] = field(default_factory=dict)
    unseen: dict[str, str] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def gathered(self) -> Gathered:
        """For the checks to read."""
        return Gathered(
            api=self.lab.api,
            agents=self.lab.agents,
            looks={probe: tuple(looks) for probe, looks in self.looks.items()},
            unseen=self.unseen,
        )


def probes(names: Collection[str]) -> dict[str, Probe]:
    """The probes of these names.

    Raises:
        EvidenceError: there is no such probe.
    """
    found = plugins.load(GROUP, PACKAGE).found
    known = {name: part for name, part in found.items() if isinstance(part, Probe)}
    missing = sorted(set(names) - known.keys())
    if missing:
        raise EvidenceError(
            f"a check needs a probe that isn't there: {', '.join(missing)}",
            where=GROUP,
            expected=", ".join(sorted(known)),
        )
    return {name: known[name] for name in sorted(names)}


def lab_of(
    opened: Opened,
    contract: Contract | None,
    *,
    spec: object,
    kwargs: Mapping[str, Any],
    seed: int,
    budget: int,
    deadline_s: float | None = None,
    beat: Callable[[], None] | None = None,
) -> Lab:
    """The bench for an environment that is open and wasn't reset yet."""
    declared = contract or Contract()
    agents = {each.name: each for each in agent_specs(opened.env, declared)}
    return Lab(
        probe="", opened=opened, spec=spec, kwargs=kwargs, api=opened.api, contract=declared,
        agents=agents, seed=seed + 1, ration=budget, meter=Meter(deadline_s, beat=beat),
    )  # fmt: skip


def gather(
    lab: Lab,
    names: Collection[str],
    *,
    died: Mapping[str, str],
    on_probe: Callable[[str, int, int], None],
) -> Gathering:
    """Lets the probes of these names look, one after the other, each within its ration.

    Args:
        lab: its ration is that of all together.
        died: probes in which the process of an earlier try died or hung, and what was said of it;
            they don't look again.
        on_probe: called with a probe's name, its place and their number, before it looks.
    """
    found = probes(names)
    gathering = Gathering(lab, found)
    total = sum(probe.SHARE for probe in found.values())
    for place, (name, probe) in enumerate(found.items()):
        on_probe(name, place, len(found))
        if name in died:
            where = lab.for_probe(name, 0).at()
            gathering.looks[name] = [Look(facts=(Fact(DIED, where, died[name]),))]
            gathering.unseen[name] = f"the environment's process {died[name]}"
            continue
        reason = _reason_against(probe, lab)
        if reason is not None:
            gathering.unseen[name] = reason
            continue
        begun_s = time.perf_counter()
        part = probe.SHARE / total
        _probe(gathering, name, probe, int(lab.ration * part), int(EVIDENCE_BYTES * part))
        gathering.seconds[name] = time.perf_counter() - begun_s
    return gathering


def look_once(lab: Lab, probe: Probe, play: Play) -> Look:
    """What one play of a probe comes to; its instances are closed.

    Raises:
        Stopped: the time is up.
    """
    lab.base = None
    try:
        saw = list(probe.look(lab, play))
    finally:
        lab.close()
    return Look(
        traces=tuple(each for each in saw if not isinstance(each, Fact | Twin)),
        twins=tuple(slimmed(each) for each in saw if isinstance(each, Twin)),
        facts=tuple(each for each in saw if isinstance(each, Fact)),
    )


def _reason_against(probe: Probe, lab: Lab) -> str | None:
    api = getattr(probe, "API", None)
    if api is not None and api != lab.api:
        return f"only for {'AEC' if api == 'aec' else 'Parallel'} environments"
    if getattr(probe, "FRESH", False) and not lab.can_make:
        return "a second instance is needed, and only an object was handed over"
    against = getattr(probe, "against", None)
    reason: str | None = None if against is None else against(lab)
    return reason


def _probe(gathering: Gathering, name: str, probe: Probe, ration: int, size_bytes: int) -> None:
    lab = gathering.lab.for_probe(name, ration)
    longest, held = most_turns(lab, size_bytes), 0
    looks = gathering.looks.setdefault(name, [])
    begun = lab.meter.steps
    plays = getattr(probe, "plays", None)
    try:
        for number, play in enumerate(lab.plays(3) if plays is None else plays(lab)):
            if number and (lab.meter.steps - begun >= ration or held >= size_bytes):
                break
            lab.number = number
            play = replace(play, most_turns=min(play.most_turns, longest))
            looks.append(look_once(lab, probe, play))
            held += held_bytes(looks[-1])
            gathering.plays[name, number] = lab.base or play
    except Stopped:
        if not looks:
            gathering.unseen[name] = "the time was up"
    except KeyboardInterrupt:
        raise
    except BaseException:  # a fault of the probe's, told as one; the other probes go on
        gathering.broken[name] = traceback.format_exc()
