"""Checks of declared reward terms."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, Case, Cases, check
from gamekeeper.checks.facts.episode_facts import Payment
from gamekeeper.checks.literal import literal
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.contract import Contract, RewardTerm
from gamekeeper.episodes.episode import Episode, Turn

PRECISION: Final = 1e-6
"""Precision, as a part of the sum of absolute values: rewards may be float32."""


@dataclass(frozen=True, slots=True)
class PaidTerms:
    """Rewards of one step by term.

    Attributes:
        terms: by term, then by agent; an agent that isn't named was paid 0.
        payable: agents that were live and hadn't ended before it.
    """

    episode: Episode
    turn: Turn
    terms: Mapping[str, Mapping[str, float]]
    payable: frozenset[str]


def all_paid(contract: Contract, evidence: ProbeEvidence) -> Iterator[PaidTerms]:
    """Every step by term: as the environment tells its terms, or the only one there is."""
    only = next(iter(contract.rewards)) if len(contract.rewards) == 1 else None
    for episode in evidence["rollout"]:
        live: set[str] = set()
        for turn in episode.turns:
            live = set(turn.live) if evidence.api == "parallel" else _now(live, turn)
            if not turn.order or any("reward" in fields for fields in turn.nonconforming.values()):
                continue
            by_term: dict[str, dict[str, float]] = {}
            for agent, terms in turn.terms.items():
                for name, value in terms.items():
                    by_term.setdefault(name, {})[agent] = value
            if not by_term and only is not None:
                by_term = {only: dict(turn.rewards)}
            if by_term:
                yield PaidTerms(episode, turn, by_term, frozenset(live - turn.ended))
            live -= turn.ended


def is_zero(value: float, scale: float) -> bool:
    """Zero but for what rounding leaves; `scale` is the sum of absolute values."""
    return abs(value) <= PRECISION * scale


def _now(live: set[str], turn: Turn) -> set[str]:
    """The roster of an AEC turn: rows stand only for those who acted, were paid or changed."""
    gone = {agent for agent in turn.agents if agent not in turn.live}
    begun = set(turn.live) if turn.index == 0 else turn.live - turn.ended
    return (live | begun) - gone


def _no_sum(contract: Contract, evidence: ProbeEvidence) -> str | None:
    if not contract.rewards:
        return "no reward terms are declared"
    told = any(turn.terms for episode in evidence["rollout"] for turn in episode.turns)
    return None if told else "the environment doesn't tell its rewards by term (`terms`)"


@check(
    "GK408",
    HIGH,
    "rollout",
    applies=_no_sum,
    looks_at="reward terms that the contract declares and the environment tells",
)
def terms_add_up(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The declared reward terms add up to the reward: nothing is paid beside them.

    Attribution and the report tell who earned what by term; a part that has no term is credited to
    nobody.

    Bad:
        self.add_reward(agent, 1.0, term="delivery")
        self.rewards[agent] += bonus              # under no term

    Good:
        self.add_reward(agent, 1.0, term="delivery")
        self.add_reward(agent, bonus, term="bonus")      # declared: [rewards.bonus]

    Fix: pay every part of the reward under a term that the contract declares
    """
    for episode in evidence["rollout"]:
        for turn in episode.turns:
            for agent, terms in turn.terms.items():
                reward = turn.rewards.get(agent)
                if reward is None:
                    continue
                left = reward - sum(terms.values())
                scale = abs(reward) + sum(map(abs, terms.values()))
                where = episode.at(turn, agent, "terms")
                seen = f"{dict(terms)!r}, which leaves {left!r}"
                proof = _sum_proof(evidence.api, agent)
                yield Case(where, is_zero(left, scale), f"{reward!r}, the reward", seen, proof)


def _sum_proof(api: str, agent: str) -> str:
    reward = "rewards" if api == "parallel" else "env.rewards"
    return (
        f"paid = {{str(a): r for a, r in {reward}.items()}}[{agent!r}]\n"
        f"terms = {{str(a): t for a, t in env.unwrapped.terms.items()}}[{agent!r}]\n"
        f"left, parts = paid - sum(terms.values()), [paid, *terms.values()]\n"
        f"assert abs(left) <= {PRECISION} * sum(map(abs, parts)), (paid, terms)"
    )


JUDGED: Final = ("shared", "zero-sum")


def _no_shared_term(contract: Contract, evidence: ProbeEvidence) -> str | None:
    if not any(term.kind in JUDGED for term in contract.rewards.values()):
        return "no term is declared as shared or as zero-sum"
    return None


@check(
    "GK409",
    HIGH,
    "rollout",
    applies=_no_shared_term,
    looks_at="a payment of a term that is declared shared or zero-sum",
)
def terms_are_shared_as_declared(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A shared reward term pays all its payees the same, and a zero-sum term's payments sum to 0.

    Looked at in every step, among payees that hadn't ended before it. Methods for teams assume one
    common reward, methods for two players that one's gain is the other's loss.

    Bad:
        [rewards.delivery]
        kind = "shared"                           # and only who delivers is paid

    Good:
        for agent in self.agents:
            self.add_reward(agent, 1.0, term="delivery")

    Fix: pay a shared term to all its payees alike and let a zero-sum term's payments cancel out in
    every step, or declare another kind
    """
    for paid in all_paid(contract, evidence):
        for name, term in contract.rewards.items():
            if term.kind in JUDGED and name in paid.terms:
                yield from _look(contract, evidence.api, paid, name, term)


def _look(contract: Contract, api: str, paid: PaidTerms, name: str, term: RewardTerm) -> Cases:
    values = {
        agent: paid.terms[name].get(agent, 0.0)
        for agent in sorted(paid.payable)
        if _is_payee(contract, term, agent)
    }
    if len(values) < 2 or not any(values.values()):
        return
    scale = sum(map(abs, values.values()))
    is_shared = term.kind == "shared"
    left = max(values.values()) - min(values.values()) if is_shared else sum(values.values())
    yield Case(
        paid.episode.at(paid.turn, None, "rewards"),
        is_zero(left, scale),
        f"{name}: the same for all payees" if is_shared else f"{name}: payments that sum to 0",
        f"{values!r}",
        proof=_shared_term_proof(api, name, list(values), is_shared=is_shared),
    )


def _is_payee(contract: Contract, term: RewardTerm, agent: str) -> bool:
    payees = term.payee or ("all",)
    return "all" in payees or contract.role_of(agent) in payees


def _shared_term_proof(api: str, name: str, payees: list[str], *, is_shared: bool) -> str:
    rewards = "rewards" if api == "parallel" else "env.rewards"
    fault = "max(paid) - min(paid)" if is_shared else "sum(paid)"
    return (
        f"terms = getattr(env.unwrapped, 'terms', None) or {{}}\n"
        f"found = {{str(a): t.get({name!r}, 0.0) for a, t in terms.items()}}\n"
        f"found = found or {{str(a): r for a, r in {rewards}.items()}}\n"
        f"paid = [found.get(a, 0.0) for a in {payees!r}]\n"
        f"assert abs({fault}) <= {PRECISION} * sum(map(abs, paid)), paid"
    )


LEAST = 2
"""Payments of a positive term that must look wrong, and none right."""


def _declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    if any(t.kind == "individual" and t.payee == ("earner",) for t in contract.rewards.values()):
        return None
    return "no reward term is declared as individual and paid to its earner"


@check("GK421", HIGH, "alternatives", confidence=0.9, applies=_declared)
def individual_terms_land_on_who_earned_them(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An individual reward or penalty lands on the agent that brought it about, on no other.

    An agent that is paid for what another does learns nothing from it, and the other isn't told.

    By intervention, only for terms that the contract declares as individual with
    `payee = "earner"`: where a penalty was paid, everything else that each agent could have done at
    that turn is tried. It lands on the wrong participant where none of the payee's own alternatives
    makes it smaller, while one of another's does. Where both do, it is joint, and kept. A
    positive payment can be due to something earlier, so it takes two that look wrong and none that
    looks right.

    Bad:
        if self.occupied(target):
            self.penalties[self.standing_on(target)] -= 1   # who was bumped into pays

    Good:
        if self.occupied(target):
            self.penalties[agent] -= 1                      # who drove pays

    Fix: pay the term to the agent whose action brings it about, or declare its payee
    """
    told = [(fact, _told(fact)) for fact in evidence.facts(Payment)]
    for fact, culprit in told:
        term, is_reward = fact.value.term, fact.value.amount > 0
        alike = [c for f, c in told if f.value.term == term and f.value.amount > 0]
        is_sure = not is_reward or (len([c for c in alike if c]) >= LEAST and "" not in alike)
        if culprit is None or (culprit and not is_sure):
            continue
        agent, amount = fact.value.agent, fact.value.amount
        yield Case(
            fact.where,
            not culprit,
            f"{term!r} is paid to the agent that brings it about",
            f"{agent!r} is paid {amount}, which nothing else that it could do makes smaller; "
            f"another action of {culprit!r} does",
            proof=_earner_proof(fact, culprit, evidence.api) if culprit else None,
        )


def _told(fact: Fact[Payment]) -> str | None:
    """Agent to blame in the payee's place; empty: the payee itself; None: it can't be told."""
    movers = fact.value.movers
    own = movers.get(fact.value.agent)
    if own is None or not own.tried:
        return None
    if own.instead is not None:
        return ""
    return next((name for name, each in movers.items() if each.instead is not None), None)


def _earner_proof(fact: Fact[Payment], culprit: str, api: str) -> Reproducer:
    payee, last = fact.value.agent, fact.where.turn or 0
    then = fact.value.movers[culprit]
    turn, action = then.turn, literal(then.instead)
    if api == "parallel":
        action = f"{{**other[{turn}], {culprit!r}: {action}}}"
        play = f"        paid = env.step(each)[1].get({payee!r}, 0.0)\n"
    else:
        play = (
            "        env.last()\n"
            "        env.step(each)\n"
            f"        paid = env.rewards.get({payee!r}, 0.0)\n"
        )
    return Reproducer(
        "def payment(actions):\n"
        "    env = make()\n"
        "    env.reset(seed=SEED)\n"
        "    for each in actions:\n"
        f"{play}"
        "    return paid\n"
        "\n"
        f"actions = list(ACTIONS[:{last + 1}])\n"
        "other = list(actions)\n"
        f"other[{turn}] = {action}\n"
        f"# only what {culprit!r} does is different\n"
        "assert abs(payment(other)) >= abs(payment(actions)), (payment(other), payment(actions))",
        plays=False,
        compares=True,
    )
