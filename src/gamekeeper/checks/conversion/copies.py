"""Checks of copies of an environment, and of its conversion to the Parallel API."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from gamekeeper.checks.check import MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.copy_facts import ConvertedEnv, CopiedEnv, WithinCycle
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import becomes_parallel, copies_go_on, cycles_close
from gamekeeper.checks.verdict import MINOR
from gamekeeper.contract import Contract

ANEW: Final = "begins anew"
"""Said of a copy that wants a reset, which is all that worker processes need."""


def copied_cases(evidence: ProbeEvidence, way: str, who: str) -> Cases:
    """Yields a case for every copy made in this way, of the `copy` or of the `original`."""
    for fact in evidence.facts(CopiedEnv):
        if fact.where.field != way or (who == "copy" and fact.value.refused):
            continue
        if who == "original" and fact.value.refused and fact.value.original is None:
            continue
        if who == "original" and fact.value.is_apart:
            continue
        wrong = fact.value.copy if who == "copy" else fact.value.original
        where = replace(fact.where, turn=None if wrong is None else fact.where.turn)
        expected = "it goes on like an episode of which no copy was made"
        whose = "apart" if fact.value.is_apart else who
        proof = reproducer_of(copies_go_on, compares=True, at=fact.value.at, way=way, who=whose)
        yield Case(where, wrong is None, expected, "it does" if wrong is None else wrong, proof)


def refused(way: str) -> Callable[[Contract, ProbeEvidence], str | None]:
    """Reason why there is no case: copying isn't promised."""

    def against(contract: Contract, evidence: ProbeEvidence) -> str | None:
        reasons = [f.value.refused for f in evidence.facts(CopiedEnv) if f.where.field == way]
        if not reasons or not all(reasons):
            return None
        begins_anew = ANEW in str(reasons[0])
        start = "" if begins_anew else MINOR
        needed = "search in copies" if way == "deepcopy" else "worker processes"
        return f"{start}no {way} of it goes on, which {needed} would need ({reasons[0]:.120})"

    return against


@check("GK701", MEDIUM, "copies", applies=refused("deepcopy"))
def deepcopies_go_on_the_same(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A copy.deepcopy made in mid-episode continues like its original, state() too.

    Tree search and counterfactual estimates play on in copies. A copy that has lost a part of the
    state, a view of an array or the place in the random stream, plays another game; so does one
    whose closures read its original, which shows once the original is somewhere else.

    Bad:
        self.world = np.zeros(8)
        self.position = self.world[:4]          # a view: in a deep copy it is an array of its own

    Good:
        self.position, self.goal = np.zeros(4), np.zeros(4)
        def state(self):
            return np.concatenate([self.position, self.goal])

    Refusing to be copied is fine: nobody promises it.

    Fix: let every attribute be copied (views of arrays and closures aren't), or raise in
    __deepcopy__
    """
    yield from copied_cases(evidence, "deepcopy", "copy")


@check("GK702", MEDIUM, "copies", applies=refused("deepcopy"))
def originals_go_on_beside_a_deepcopy(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Stepping a copy.deepcopy doesn't move its original.

    A planner that tries a move in a copy would have made it in the game itself.

    Bad:
        def __deepcopy__(self, memo):
            counterfactual = type(self)()
            counterfactual.__dict__.update(self.__dict__)     # the same board, the same generator
            return counterfactual

    Good: leave `__deepcopy__` alone, or copy every attribute in it.

    Fix: keep the state in the instance: no class attributes, globals or shared generators,
    and copy all of it in __deepcopy__
    """
    yield from copied_cases(evidence, "deepcopy", "original")


@check("GK703", MEDIUM, "copies", applies=refused("pickle"))
def pickled_copies_go_on_the_same(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A copy by pickle made in mid-episode continues like its original, state() too.

    Checkpoints and worker processes pickle environments. What is left out of the pickle, such as
    the place in the random stream, is another game from there on.

    Bad:
        def __getstate__(self):
            return {k: v for k, v in self.__dict__.items() if k != "rng"}

    Good: pickle the generator too; `np.random.Generator` can be pickled.

    Refusing to be pickled is fine, and so is a copy that begins anew and wants a reset (EzPickle).

    Fix: leave nothing of the state out of __getstate__, or raise there
    """
    yield from copied_cases(evidence, "pickle", "copy")


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


@check("GK710", MEDIUM, "conversion", api="aec", applies=not_said)
def parallelizable_means_in_cycles(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An environment whose metadata say is_parallelizable can be stepped by aec_to_parallel.

    Libraries ask this flag and convert. A turn order that rotates, skips or repeats, or a death in
    mid-cycle, ends in an AssertionError in the middle of a training run.

    Bad:
        metadata = {"name": "auction_v1", "is_parallelizable": True}    # yet the opener rotates

    Good:
        metadata = {"name": "auction_v1", "is_parallelizable": False}

    Fix: let all live agents act in the order of `agents` in every cycle, deaths at its end; or say
    "is_parallelizable": False
    """
    for fact in evidence.facts(ConvertedEnv):
        failed = fact.value.failed
        if fact.value.ticks or failed is not None:
            expected = "aec_to_parallel steps it"
            seen = "it does" if failed is None else failed
            yield Case(fact.where, failed is None, expected, seen, reproducer_of(becomes_parallel))


@check("GK711", MEDIUM, "conversion", api="aec", applies=not_converted)
def cycles_show_nothing_before_their_end(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """With is_parallelizable, no agent observes an action of the same cycle.

    PettingZoo's aec_to_parallel shows everybody what is to be seen at the end of a cycle. Where an
    agent's observation changes by moves before its own, the converted game is another one: its
    agents decide on what is out of date.

    Bad:
        metadata = {"is_parallelizable": True}
        def step(self, action):
            self.board[self.agent_selection] = action       # the next in turn sees it at once

    Good: collect the actions, and resolve them when the last agent of the cycle has acted.

    Source: PettingZoo's documentation of `aec_to_parallel`.

    Fix: change what agents observe at the end of a cycle only; or say "is_parallelizable": False
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
