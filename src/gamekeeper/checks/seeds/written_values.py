"""Checks of values that are written into by their reader: they are copies."""

from __future__ import annotations

from collections.abc import Callable

from gamekeeper.checks.case import Case, Cases
from gamekeeper.checks.check import HIGH, MEDIUM, check
from gamekeeper.checks.facts.handed_facts import WrittenValues
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract


def written_cases(evidence: ProbeEvidence, kind: str) -> Cases:
    """Yields a case for every play in which things of this kind were overwritten."""
    for fact in evidence.facts(WrittenValues):
        if fact.where.field == kind:
            seen = fact.value.seen
            yield Case(
                fact.where,
                seen is None,
                "the play goes on as if nothing was written",
                "it goes on the same" if seen is None else seen,
                proof=fact.proof,
            )


def none_of(kind: str, reason: str) -> Callable[[Contract, ProbeEvidence], str | None]:
    """Says that nothing of this kind can be written into, where that was looked at."""

    def against(contract: Contract, evidence: ProbeEvidence) -> str | None:
        kinds = {fact.where.field for fact in evidence.facts(WrittenValues)}
        return reason if kinds and kind not in kinds else None

    return against


@check(
    "GK620",
    needs=("written",),
    severity=HIGH,
    fix="return copies: no array that the rules, or a cache, will read again",
    applies=none_of("observations", "observations hold no array that can be written to"),
)
def written_observations_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an observation doesn't change the game.

    Wrappers and learners scale observations in place. Where those are the game's own arrays, an
    agent moves pieces by looking at them.

    Bad:
        def observe(self, agent):
            return self.board

    Good:
        def observe(self, agent):
            return self.board.copy()
    """
    yield from written_cases(evidence, "observations")


@check(
    "GK621",
    needs=("written",),
    severity=HIGH,
    fix='put copies into infos: `{"position": self.position.copy()}`',
    applies=none_of("infos", "infos hold no array that can be written to"),
)
def written_infos_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an array of an info doesn't change the game.

    Wrappers scale what they find there in place. Where it is the game's own array, they move it.

    Bad:
        infos[agent] = {"position": self.position[agent]}       # a view of the game's own array

    Good:
        infos[agent] = {"position": self.position[agent].copy()}
    """
    yield from written_cases(evidence, "infos")


@check(
    "GK622",
    needs=("written",),
    severity=HIGH,
    fix="return a copy from state(): `return self.world.copy()`",
    applies=none_of("state", "it has no state() that only looks and hands out arrays"),
)
def written_states_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into what state() handed out doesn't change the game.

    A central critic that normalises its input in place would move the agents themselves.

    Bad:
        def state(self):
            return self.world

    Good:
        def state(self):
            return self.world.copy()        # the caller's own
    """
    yield from written_cases(evidence, "state")


@check(
    "GK623",
    needs=("written",),
    severity=MEDIUM,
    fix="return new dictionaries: `return observations, dict(self.rewards), ...`",
    api="parallel",
)
def emptied_dictionaries_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Emptying the dictionaries that reset and step returned doesn't change the game.

    Wrappers take entries of agents that are gone out of them. Where they are the environment's own
    books, its next step crashes or forgets who has ended.

    Bad:
        return observations, self.rewards, self.terminations, self.truncations, self.infos

    Good:
        return observations, dict(self.rewards), dict(self.terminations), ...
    """
    yield from written_cases(evidence, "dictionaries")


@check(
    "GK624",
    needs=("written",),
    severity=MEDIUM,
    fix='hand out a copy of the mask: `{"action_mask": self.legal.copy()}`',
    applies=none_of("masks", "no action mask is handed out that can be written to"),
)
def written_masks_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an action mask, in an observation or an info, doesn't change what is legal.

    An agent that edits its mask, to forbid more to itself or by a normalisation in place, must not
    change the rules for itself or for others.

    Bad:
        infos[agent] = {"action_mask": self.legal}      # the array that step() asks

    Good:
        infos[agent] = {"action_mask": self.legal.copy()}
    """
    yield from written_cases(evidence, "masks")
