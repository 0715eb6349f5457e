"""GK306."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._schedule import Crossing, crossings
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

ORDERED: Final = ("fixed", "rotating")
PROOF: Final = Proof(
    """\
env = make()
env.reset(seed=SEED)
movers = []
for action in ACTIONS:
    agent = env.agent_selection
    if not (env.terminations[agent] or env.truncations[agent]):
        movers.append(agent)
    env.last()
    env.step(action)
raise AssertionError(f"the order was {movers}")  # the finding says where it isn't as declared""",
    plays=False,
)


def _undeclared(contract: Contract, evidence: Gathered) -> str | None:
    schedule = contract.schedule
    if schedule.order in ORDERED or len(schedule.stages or ()) > 1:
        return None
    return "no order is declared that could be looked at (fixed, rotating, or several stages)"


@check(
    "GK306",
    needs=("rollout",),
    severity=HIGH,
    api="aec",
    mend="select agents in the order that the contract declares, or declare another one",
    applies=_undeclared,
)
def order_is_as_declared(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Agents act in the declared order: stage after stage, fixed or rotating, nobody left out.

    A tick is a round in which everybody who is live acts once. Who acts late sees more: an order
    that isn't the declared one gives away, or takes, what the game form promises to each role.

    Bad:
    ```toml
    [schedule]
    stages = [["picker"], ["carrier"]]        # and a carrier acts between two pickers
    order = "fixed"
    ```
    Good:
    ```python
    self._selector.reinit([*pickers, *carriers])
    ```
    """
    for play in crossings(evidence):
        live = [each for each in play if not each.is_dead]
        before: _Tick | None = None
        for tick in _ticks(live):
            yield from _looks(contract, before, tick)
            before = tick


@dataclass(frozen=True, slots=True)
class _Tick:
    """A round: who acted in it, and those who were live throughout."""

    crossings: Sequence[Crossing]
    throughout: frozenset[str]
    is_whole: bool

    @property
    def movers(self) -> list[str]:
        return [each.actor for each in self.crossings]


def _ticks(live: list[Crossing]) -> Iterator[_Tick]:
    """Rounds; a new one begins where somebody acts for the second time, or everybody has."""
    start = 0
    seen: set[str] = set()
    for place, each in enumerate(live):
        due = {agent for agent in each.before if agent not in each.ended}
        if each.actor in seen or due <= seen:
            yield _tick(live[start:place], each)
            start, seen = place, set()
        seen.add(each.actor)
    if live[start:]:
        yield _tick(live[start:], None)


def _tick(crossings: list[Crossing], following: Crossing | None) -> _Tick:
    at = [*crossings, following] if following is not None else crossings
    stayed = [frozenset(each.before) - each.ended for each in at]
    return _Tick(crossings, frozenset.intersection(*stayed), following is not None)


def _looks(contract: Contract, before: _Tick | None, tick: _Tick) -> Iterator[Occasion]:
    movers, last = tick.movers, tick.crossings[-1]
    faults = [_out_of_stage(contract, movers)]
    if tick.is_whole and contract.schedule.order in ORDERED:
        left_out = sorted(tick.throughout - set(movers))
        faults.append(f"{left_out} didn't act in the round {movers}" if left_out else None)
    if before is not None and tick.is_whole:
        faults.append(_out_of_order(contract, before, tick))
    for fault in faults:
        yield Occasion(
            tick.crossings[0].trace.at(last.turn, last.actor, "order"), fault is None,
            _declared(contract), fault, proof=PROOF,
        )  # fmt: skip


def _declared(contract: Contract) -> str:
    stages = contract.schedule.stages
    told = f", stages {[list(each) for each in stages]}" if stages else ""
    return f"order {contract.schedule.order!r}{told}"


def _stage_of(contract: Contract, agent: str) -> int:
    role = contract.role_of(agent)
    stages = contract.schedule.stages or ()
    return next((place for place, roles in enumerate(stages) if role in roles), 0)


def _out_of_stage(contract: Contract, movers: list[str]) -> str | None:
    places = [_stage_of(contract, agent) for agent in movers]
    return None if places == sorted(places) else f"in one round: {movers}"


def _out_of_order(contract: Contract, before: _Tick, tick: _Tick) -> str | None:
    """Against the round before, stage by stage, of those who acted in both."""
    order = contract.schedule.order
    both = set(before.movers) & set(tick.movers)
    same = set(before.movers) == set(tick.movers)
    for stage in sorted({_stage_of(contract, agent) for agent in both}):
        then, now = (
            [a for a in each.movers if a in both and _stage_of(contract, a) == stage]
            for each in (before, tick)
        )
        turned = [then[n:] + then[:n] for n in range(len(then))]
        fine = {"fixed": [then], "rotating": turned[1:2] or turned if same else turned}
        if now not in fine.get(order or "", [now]):
            return f"after the round {then}: {now}"
    return None
