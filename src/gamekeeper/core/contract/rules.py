"""What sections of a contract say about each other: no declaration contradicts another."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from gamekeeper.core.contract.parts import RESERVED, RewardTerm, Role, is_single, patterns
from gamekeeper.core.contract.pattern import overlap
from gamekeeper.core.contract.places import Place, nearest
from gamekeeper.core.contract.table import Table

if TYPE_CHECKING:
    from gamekeeper.core.contract import Contract


def check_rules(contract: Contract) -> None:
    """Every role that is spoken of is declared, and nothing is declared both ways.

    Raises:
        ContractError: the first contradiction, at the place where it stands.
    """
    root = Place(contract.places)
    _check_roles(contract.roles, root / "roles")
    _check_schedule(contract, root / "schedule")
    for name, term in contract.rewards.items():
        _check_term(term, contract.roles, root / "rewards" / name)
    for name, ending in contract.endings.items():
        if ending.owner is not None:
            place = root / "endings" / name / "owner"
            _check_known(place, ending.owner, ("agent", "all", *contract.roles))
    for name, knob in contract.knobs.items():
        for position, other in enumerate(knob.contains or ()):
            if other not in contract.knobs or other == name:
                place = root / "knobs" / name / "contains" / position
                others = [known for known in contract.knobs if known != name]
                raise place.unknown(f"knob {other!r} is not declared", other, others, noun="knob")
    for scope in contract.failure:
        _check_known(root / "failure" / scope, scope, ("team", "agent", *contract.roles))


def with_staged(contract: Contract) -> Table[Role]:
    """The declared roles, and those that are declared by standing in a stage alone.

    Raises:
        ContractError: one of the latter is a declared role's name misspelt, as far as can be seen:
            it is close to a role that no stage names.
    """
    roles = dict(contract.roles)
    stages = contract.schedule.stages or ()
    unstaged = [name for name in roles if not any(name in stage for stage in stages)]
    for number, stage in enumerate(stages):
        for position, name in enumerate(stage):
            if name not in roles and nearest(name, unstaged):
                place = Place(contract.places, ("schedule", "stages", number, position))
                raise place.unknown(f"role {name!r} is not declared", name, unstaged, noun="role")
            roles.setdefault(name, Role())
    return Table(roles)


def _check_known(at: Place, name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise at.unknown(f"role {name!r} is not declared", name, known, noun="role")


def _check_roles(roles: Mapping[str, Role], at: Place) -> None:
    seen: list[tuple[str, str]] = []
    for name, role in roles.items():
        if name in RESERVED:
            raise (at / name).error(
                f"no role can be called {name!r}",
                expected="a name of your own",
                seen=name,
                mend=f"{name!r} is a word of contracts: call the role something else",
            )
        for pattern in patterns(name, role):
            for other, taken in seen:
                if other != name and overlap(pattern, taken):
                    # The line of the one that says which agents it holds, where one says nothing.
                    wrong = name if role.agents or not roles[other].agents else other
                    raise (at / wrong / "agents").error(
                        f"roles {other!r} and {name!r} can both hold an agent",
                        expected="patterns that no name fits both of",
                        seen=f"{taken} and {pattern}",
                        mend="make one pattern narrower, or list its agents by name",
                    )
            seen.append((name, pattern))


def _check_schedule(contract: Contract, at: Place) -> None:
    schedule = contract.schedule
    if contract.api == "parallel" and schedule.observe == "after turn":
        raise (at / "observe").error(
            "a parallel environment can't show anything before its tick is over",
            expected='"after tick"',
            seen=schedule.observe,
            mend='write observe = "after tick", or api = "aec"',
        )
    if schedule.order == "none" and schedule.conflicts == "ordered":
        raise (at / "conflicts").error(
            "conflicts are settled by an order of acting that there isn't",
            expected='"joint rule", "priority" or "random"',
            seen=schedule.conflicts,
            mend="declare the order in schedule.order, or another rule for conflicts",
        )


def _check_term(term: RewardTerm, roles: Mapping[str, Role], at: Place) -> None:
    for key, extra in (("earner", ("all",)), ("payee", ("all", "earner"))):
        names: tuple[str, ...] = getattr(term, key) or ()
        for number, name in enumerate(names):
            place = at / key / number if len(names) > 1 else at / key
            _check_known(place, name, (*extra, *roles))
        if len(names) > 1 and set(names) & set(extra):
            raise (at / key).error(
                f"'{at.text}.{key}' names roles beside a word for all of them",
                expected="roles, or one of " + ", ".join(extra),
                seen=list(names),
                mend="leave one out",
            )
    payees = term.payee or ()
    one = payees == ("earner",) or (len(payees) == 1 and is_single(roles.get(payees[0], Role())))
    if term.kind == "zero-sum" and one:
        raise (at / "payee").error(
            f"the zero-sum term {at.path[-1]!r} has one payee, so it always pays 0",
            expected="two payees or more, or all",
            seen=list(payees),
            mend='write payee = "all", or another kind',
        )
    if term.kind == "shared" and payees == ("earner",):
        raise (at / "payee").error(
            f"the shared term {at.path[-1]!r} pays only the agent that earned it",
            expected="roles, or all",
            seen="earner",
            mend='write kind = "individual", or payee = "all"',
        )
    if term.kind == "individual" and payees == ("all",) and term.earner not in (None, ("all",)):
        raise (at / "payee").error(
            f"the individual term {at.path[-1]!r} pays agents that didn't earn it",
            expected="the role that earns it, or earner",
            seen="all",
            mend='write kind = "shared", or payee = "earner"',
        )
