"""Checks of orders: of turns as declared, of moves made at once, and of an action dictionary."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, Case, Cases, check
from gamekeeper.checks.effects import later_looks
from gamekeeper.checks.facts.episode_facts import OrderOutcome
from gamekeeper.checks.literal import literal
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import shows_order
from gamekeeper.checks.timing.agent_turns import AecStep, aec_steps
from gamekeeper.contract import Contract
from gamekeeper.statistics.significance import holm

ORDERED: Final = ("fixed", "rotating")


def _undeclared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    schedule = contract.schedule
    if schedule.order in ORDERED or len(schedule.stages or ()) > 1:
        return None
    return "no order is declared that could be looked at (fixed, rotating, or several stages)"


@check(
    "GK306",
    HIGH,
    "rollout",
    api="aec",
    applies=_undeclared,
    looks_at="an order of agents that the contract declares",
)
def order_is_as_declared(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Agents act in the declared order: stage after stage, fixed or rotating, none left out.

    A tick is a round in which everybody who is live acts once. Who acts late sees more: an order
    that isn't the declared one gives away, or takes, what the structure promises to each role.

    Bad:
        [schedule]
        stages = [["picker"], ["carrier"]]        # and a carrier acts between two pickers
        order = "fixed"

    Good:
        self._selector.reinit([*pickers, *carriers])

    Fix: select agents in the order that the contract declares, or declare another one
    """
    for play in aec_steps(evidence):
        live = [each for each in play if not each.is_dead]
        before: _Tick | None = None
        for tick in _ticks(live):
            yield from _looks(contract, before, tick)
            before = tick


@dataclass(frozen=True, slots=True)
class _Tick:
    """A round: who acted in it, and those who were live throughout."""

    env_steps: Sequence[AecStep]
    throughout: frozenset[str]
    is_whole: bool

    @property
    def movers(self) -> list[str]:
        return [each.actor for each in self.env_steps]


def _ticks(live: list[AecStep]) -> Iterator[_Tick]:
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


def _tick(env_steps: list[AecStep], following: AecStep | None) -> _Tick:
    at = [*env_steps, following] if following is not None else env_steps
    stayed = [frozenset(each.before) - each.ended for each in at]
    return _Tick(env_steps, frozenset.intersection(*stayed), following is not None)


def _looks(contract: Contract, before: _Tick | None, tick: _Tick) -> Cases:
    movers, last = tick.movers, tick.env_steps[-1]
    faults = [_out_of_stage(contract, movers)]
    if tick.is_whole and contract.schedule.order in ORDERED:
        left_out = sorted(tick.throughout - set(movers))
        faults.append(f"{left_out} didn't act in the round {movers}" if left_out else None)
    if before is not None and tick.is_whole:
        faults.append(_out_of_order(contract, before, tick))
    for fault in faults:
        where = tick.env_steps[0].episode.at(last.turn, last.actor, "order")
        expected = _declared_order_applies(contract)
        yield Case(where, fault is None, expected, fault, reproducer_of(shows_order))


def _declared_order_applies(contract: Contract) -> str:
    stages = contract.schedule.stages
    told = f", stages {[list(each) for each in stages]}" if stages else ""
    return f"order {contract.schedule.order!r}{told}"


def _out_of_stage(contract: Contract, movers: list[str]) -> str | None:
    places = [_stage(contract, agent) or 0 for agent in movers]
    return None if places == sorted(places) else f"in one round: {movers}"


def _out_of_order(contract: Contract, before: _Tick, tick: _Tick) -> str | None:
    """Against the round before, stage by stage, of those who acted in both."""
    order = contract.schedule.order
    both = set(before.movers) & set(tick.movers)
    same = set(before.movers) == set(tick.movers)
    for stage in sorted({_stage(contract, agent) or 0 for agent in both}):
        then, now = (
            [a for a in each.movers if a in both and (_stage(contract, a) or 0) == stage]
            for each in (before, tick)
        )
        turned = [then[n:] + then[:n] for n in range(len(then))]
        fine = {"fixed": [then], "rotating": turned[1:2] or turned if same else turned}
        if now not in fine.get(order or "", [now]):
            return f"after the round {then}: {now}"
    return None


def _hidden_moves_applies(contract: Contract, evidence: ProbeEvidence) -> str | None:
    schedule = contract.schedule
    if schedule.order == "none" or schedule.observe == "after tick":
        return None
    return "the contract doesn't declare that agents act at once (schedule.order, .observe)"


@check("GK331", HIGH, "influence", api="aec", applies=_hidden_moves_applies)
def moves_of_the_tick_stay_hidden(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Later agents of a simultaneous tick don't observe what earlier ones did in it.

    An environment that takes simultaneous actions in turns must hide the moves of the tick: else
    the last to act answers them, and it is another task, won by whoever is asked last.

    By intervention: one agent's action is replaced, and what later agents of the same tick and
    stage observe is compared.

    Bad:
        def step(self, action):
            self.hands[self.agent_selection] = action   # observe() shows self.hands

    Good:
        def step(self, action):
            self.chosen[self.agent_selection] = action
            if self.is_last():
                self.hands = dict(self.chosen)

    Fix: let observe() show what was at the start of the tick until all have acted, or declare
    schedule.observe = "after turn"
    """
    for counterfactual in evidence.counterfactuals("influence"):
        start, agent = int(counterfactual.change["turn"]), str(counterfactual.change["agent"])
        action = counterfactual.change["action"]
        for (turn, other), is_seen in later_looks(counterfactual):
            if _stage(contract, agent) == _stage(contract, other):
                where = counterfactual.base.at(turn, other, "observations")
                expected = f"the same observation whatever {agent!r} did at turn {start} of"
                seen = f"another one where {agent!r} does {literal(action)}"
                proof = _proof(start, turn, action)
                yield Case(where, not is_seen, f"{expected} this tick", seen, proof)


def _stage(contract: Contract, agent: str) -> int | None:
    """The place of the agent's stage; None where no stages are declared."""
    role = contract.role_of(agent)
    stages = contract.schedule.stages or ()
    return next((place for place, stage in enumerate(stages) if role in stage), None)


def _proof(start: int, turn: int, action: Any) -> Reproducer:
    return Reproducer(
        "def seen(actions):\n"
        "    env = make()\n"
        "    env.reset(seed=SEED)\n"
        "    for action in actions:\n"
        "        env.last()\n"
        "        env.step(action)\n"
        "    return env.last()[0]\n"
        "\n"
        "other = list(ACTIONS)\n"
        f"other[{start}] = {literal(action)}\n"
        f"np.testing.assert_equal(seen(other[:{turn}]), seen(ACTIONS[:{turn}]))",
        plays=False,
        compares=True,
    )


LEVEL = 0.01
"""Chance of calling a mere change of draws an outcome, over all looks together."""
ORDERS: Final[dict[str, str]] = {
    "reversed": "agents[::-1]",
    "rotated": "agents[1:] + agents[:1]",
    "shuffled": "random.Random(turn).sample(agents, len(agents))",
}
"""Every order as an expression over `agents` and `turn`, as a program may have it."""
IN_TURN = ("fixed", "rotating", "state", "random")


def _declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    schedule = contract.schedule
    if schedule.conflicts in ("ordered", "priority"):
        return f"the contract declares conflicts as {schedule.conflicts!r}"
    if schedule.order in IN_TURN:
        return f"the contract declares that agents act in an order ({schedule.order})"
    return None


@check("GK311", HIGH, "order", api="parallel", applies=_declared)
def outcome_is_free_of_the_actions_order(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The outcome of a joint action doesn't depend on the order of the action dictionary.

    A dictionary has no order to promise: trainers take agents from lists, sets, sorted names. Where
    the first in it wins a conflict, they train another task than the one described.

    Whole episodes are played again with the dictionary reversed and shuffled, against a rerun with
    nothing changed. Where a difference shows and no generator has moved, it is the outcome. Where
    something was drawn, both orders get fresh random futures from the same state (20 each) and a
    permutation test over all numbers of the outcome (max-T, 4,999 permutations; at other states a
    sign-flip test) says whether they have one distribution, corrected by Holm over all looks: the
    chance that mere draws are called an outcome is at most 1 %.

    Bad:
        for agent, action in actions.items():  # who stands first takes the cell
            if target(agent, action) not in taken:
                self.cells[agent] = target(agent, action)

    Good:
        wanted = {agent: target(agent, actions[agent]) for agent in self.agents}
        for agent, cell in wanted.items():     # two that want one cell both stay
            if [*wanted.values()].count(cell) == 1:
                self.cells[agent] = cell

    Fix: settle the joint action by a rule that is free of order (collect what all do, then
    resolve), or go through `self.agents` and declare the order in the contract
    """
    facts = list(evidence.facts(OrderOutcome))
    corrected = iter(holm([p for fact in facts for p in fact.value.p_values]))
    for fact in facts:
        value = fact.value
        p = min((next(corrected) for _ in value.p_values), default=1.0)
        is_outcome = value.result == "outcome" or p <= LEVEL
        if is_outcome or value.result in ("same", "rounding", "draws"):
            yield Case(
                fact.where,
                not is_outcome,
                "the same whatever the order of the dictionary",
                _seen(fact),
                proof=proof_of_order(value.order),
                confidence=1.0 if value.result == "outcome" else 1.0 - min(p, 0.5),
            )


def _seen(fact: Fact[OrderOutcome]) -> str:
    value = fact.value
    if value.turn is None:
        return f"no difference in {value.ticks} ticks"
    whose = f"{value.part}[{value.agent!r}]" if value.agent else "who is there"
    return f"{whose}: {value.one!r:.120} becomes {value.two!r:.120} ({value.order})"


def proof_of_order(order: str) -> Reproducer:
    """Lines that play the actions in their order and in another, and compare what came of it."""
    return Reproducer(
        "def outcomes(order):\n"
        "    env, found = make(), []\n"
        "    env.reset(seed=SEED)\n"
        "    for turn, actions in enumerate(ACTIONS):\n"
        "        agents = order(list(actions), turn)\n"
        "        found.append(copy.deepcopy(env.step({a: actions[a] for a in agents})))\n"
        "    return found\n"
        "\n"
        "one = outcomes(lambda agents, turn: agents)\n"
        f"other = outcomes(lambda agents, turn: {ORDERS[order]})\n"
        "np.testing.assert_equal(other, one)",
        plays=False,
        imports=("copy", "random"),
        compares=True,
    )


@check("GK312", LOW, "order", confidence=0.9, api="parallel")
def draws_are_free_of_the_actions_order(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Random draws don't come in the order of the action dictionary.

    The game is the same on average, but with one seed two trainers that list agents in another
    order see other episodes, and no rollout can be repeated from seed and actions by name.

    As GK311, which tells a change of draws from a change of the outcome: here are the plays in
    which the two orders differ, something was drawn, and no test tells their distributions apart.

    Bad:
        for agent, action in actions.items():
            if self.rng.random() < 0.9:        # the draw goes to who stands first
                self.move(agent, action)

    Good:
        for agent in self.agents:
            if self.rng.random() < 0.9:
                self.move(agent, actions[agent])

    Fix: draw in the order of `self.agents`, not in that of the dictionary that was handed over
    """
    for fact in evidence.facts(OrderOutcome):
        value = fact.value
        is_drawn = value.result in ("draws", "undecided")
        if is_drawn and min(value.p_values, default=1.0) <= LEVEL:
            continue  # the outcome, which GK311 tells
        if is_drawn or value.result in ("same", "rounding"):
            expected = "the same episode whatever the order of the dictionary"
            seen = f"another one from turn {value.turn} on, with the same chances"
            yield Case(fact.where, not is_drawn, expected, seen, proof_of_order(value.order))
