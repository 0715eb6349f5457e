"""Checks of environments that say they are parallelizable."""

from __future__ import annotations

from gamekeeper.checks.check import MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.copy_facts import ConvertedEnv, WithinCycle
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import becomes_parallel, cycles_close
from gamekeeper.contract import Contract


def not_said(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why there is no case: the environment doesn't say that it is parallelizable."""
    said = [fact.value.said for fact in evidence.facts(ConvertedEnv)]
    return "its metadata don't say that it is parallelizable" if said and not any(said) else None


def not_converted(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why a converted game can't be compared: there is none."""
    failed = [fact.value.failed for fact in evidence.facts(ConvertedEnv)]
    is_told = any(each is not None for each in failed)
    return not_said(contract, evidence) or (
        "aec_to_parallel doesn't step it, as GK710 says" if is_told else None
    )


@check(
    "GK710",
    needs=("conversion",),
    severity=MEDIUM,
    fix="let all live agents act in the order of `agents` in every cycle, deaths at its end; or "
    'say "is_parallelizable": False',
    api="aec",
    applies=not_said,
)
def parallelizable_means_in_cycles(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An environment whose metadata say is_parallelizable can be stepped by aec_to_parallel.

    Libraries ask this flag and convert. A turn order that rotates, skips or repeats, or a death in
    mid-cycle, ends in an AssertionError in the middle of a training run.

    Bad:
        metadata = {"name": "auction_v1", "is_parallelizable": True}    # yet the opener rotates

    Good:
        metadata = {"name": "auction_v1", "is_parallelizable": False}
    """
    for fact in evidence.facts(ConvertedEnv):
        failed = fact.value.failed
        if fact.value.ticks or failed is not None:
            expected = "aec_to_parallel steps it"
            seen = "it does" if failed is None else failed
            yield Case(fact.where, failed is None, expected, seen, reproducer_of(becomes_parallel))


@check(
    "GK711",
    needs=("conversion",),
    severity=MEDIUM,
    fix='change what agents observe at the end of a cycle only; or say "is_parallelizable": False',
    api="aec",
    applies=not_converted,
)
def cycles_show_nothing_before_their_end(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """In an environment that says is_parallelizable, nobody observes a move of the same cycle.

    PettingZoo's aec_to_parallel shows everybody what is to be seen at the end of a cycle. Where an
    agent's observation changes by moves before its own, the converted game is another one: its
    agents decide on what is out of date.

    Bad:
        metadata = {"is_parallelizable": True}
        def step(self, action):
            self.board[self.agent_selection] = action       # the next in turn sees it at once

    Good: collect the actions, and resolve them when the last agent of the cycle has acted.

    Source: PettingZoo's documentation of `aec_to_parallel`.
    """
    for fact in evidence.facts(WithinCycle):
        changed = fact.value.changed
        for _ in range(fact.value.looks - (changed is not None)):
            yield Case(fact.where, True)
        if changed is not None:
            after = ", ".join(map(repr, changed.after)) or "nobody"
            expected = "the observation that it would have had when the cycle began"
            seen = f"another one, as {after} acted"
            yield Case(fact.where, False, expected, seen, reproducer_of(cycles_close))
