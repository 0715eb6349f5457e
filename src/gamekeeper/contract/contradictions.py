"""Contradictions of a contract with itself: each is reported where it stands, all together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations, product
from typing import TYPE_CHECKING, Final

from gamekeeper.contract.pattern import overlap
from gamekeeper.contract.sections import (
    NONE,
    RESERVED,
    Ending,
    RewardTerm,
    Role,
    Table,
    is_single,
    patterns,
)
from gamekeeper.contract.validation import SourcePath, nearest
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.contract import Contract

ORDERED: Final = ("fixed", "rotating", "state", "random")
"""Orders in which agents act one after the other."""
CHANGING: Final = ("rotating", "state", "random")
"""Orders that take two agents: of one alone there is one order."""
HORIZON: Final = "horizon"
"""Name that the base classes give the ending at the time limit."""


def check_declarations(contract: Contract, root: SourcePath) -> None:
    """Reports each role and knob that isn't declared, and each contradiction, where it stands."""
    for error in _mistakes(contract, root):
        root.report(error)


def _mistakes(contract: Contract, root: SourcePath) -> Iterator[GamekeeperError]:
    yield from _role_mistakes(contract.roles, root / "roles")
    yield from _schedule_mistakes(contract, root / "schedule")
    yield from _symmetry_mistakes(contract, root / "roles")
    for name, term in contract.rewards.items():
        yield from _term_mistakes(term, contract.roles, root / "rewards" / name)
    for name, ending in contract.endings.items():
        if ending.owner is not None:
            place = root / "endings" / name / "owner"
            yield from _undeclared(place, ending.owner, ("agent", "all", *contract.roles))
    if contract.schedule.horizon is not None and HORIZON in contract.endings:
        yield from _time_limit_mistakes(contract.endings[HORIZON], root / "endings" / HORIZON)
    for name, knob in contract.knobs.items():
        for position, other in enumerate(knob.contains or ()):
            if other not in contract.knobs or other == name:
                place = root / "knobs" / name / "contains" / position
                others = [known for known in contract.knobs if known != name]
                what = f"knob {other!r} is not declared"
                yield place.unknown(what, other, others, noun="knob")
    for scope in contract.failure:
        yield from _undeclared(root / "failure" / scope, scope, ("team", "agent", *contract.roles))


def with_staged(contract: Contract, root: SourcePath) -> Table[Role]:
    """The declared roles, and those that are declared by standing in a stage alone.

    Reports each of the latter that is a declared role's name misspelt, as far as can be seen (it
    is close to a role that no stage names), and each declared role that no stage names.
    """
    roles = dict(contract.roles)
    stages = contract.schedule.stages or ()
    unstaged = [name for name in roles if not any(name in stage for stage in stages)]
    meant: set[str | None] = set()
    for number, stage in enumerate(stages):
        for position, name in enumerate(stage):
            if name not in roles and nearest(name, unstaged):
                meant.add(nearest(name, unstaged))
                place = root / "schedule" / "stages" / number / position
                what = f"role {name!r} is not declared"
                root.report(place.unknown(what, name, unstaged, noun="role"))
            roles.setdefault(name, Role())
    for name in unstaged if stages else ():
        if name not in meant and name not in RESERVED:
            error = (root / "roles" / name).error(
                f"role {name!r} stands in no stage, so its agents never act",
                expected="each role in a stage",
                actual=[list(stage) for stage in stages],
                fix=f"add {name!r} to schedule.stages, or leave the role out",
            )
            root.report(error)
    return Table(roles)


def _undeclared(at: SourcePath, name: str, known: Iterable[str]) -> Iterator[GamekeeperError]:
    if name not in known:
        yield at.unknown(f"role {name!r} is not declared", name, known, noun="role")


def _role_mistakes(roles: Mapping[str, Role], at: SourcePath) -> Iterator[GamekeeperError]:
    for name, role in roles.items():
        if name in RESERVED:
            yield (at / name).error(
                f"no role can be called {name!r}",
                expected="a name of your own",
                actual=name,
                fix=f"{name!r} is a word of contracts: call the role something else",
            )
        if role.mask == NONE and role.illegal is not None:
            yield (at / name / "illegal").error(
                f"every action of role {name!r} is legal, as its mask is declared to be absent",
                expected="no 'illegal' beside mask = \"none\"",
                actual=role.illegal,
                fix="leave illegal out, or declare where the mask stands",
            )
    usable = [(name, role) for name, role in roles.items() if name not in RESERVED]
    for (other, first), (name, second) in combinations(usable, 2):
        both = product(patterns(other, first), patterns(name, second))
        shared = next((pair for pair in both if overlap(*pair)), None)
        if shared is not None:
            # The line of the one that says which agents it holds, where one says nothing.
            wrong = name if second.agents or not first.agents else other
            yield (at / wrong / "agents").error(
                f"roles {other!r} and {name!r} can both hold an agent",
                expected="patterns that no name fits both of",
                actual=" and ".join(shared),
                fix="make one pattern narrower, or list its agents by name",
            )


def _schedule_mistakes(contract: Contract, at: SourcePath) -> Iterator[GamekeeperError]:
    schedule, is_parallel = contract.schedule, contract.api == "parallel"
    has_later = len(schedule.stages or ()) > 1  # whose agents may observe those of an earlier stage
    if is_parallel and schedule.observe == "after turn":
        yield (at / "observe").error(
            "a parallel environment can't show anything before its tick is over",
            expected='"after tick"',
            actual=schedule.observe,
            fix='write observe = "after tick", or api = "aec"',
        )
    elif (schedule.order, schedule.observe) == ("none", "after turn") and not has_later:
        yield (at / "observe").error(
            "agents that act simultaneously don't observe one another's turns",
            expected='"after tick"',
            actual=schedule.observe,
            fix='write observe = "after tick"; or declare the order of turns in schedule.order, '
            "or stages that act after one another",
        )
    if schedule.order == "none" and schedule.conflicts == "ordered":
        yield (at / "conflicts").error(
            "conflicts are settled by an order of acting that there isn't",
            expected='"joint rule", "priority" or "random"',
            actual=schedule.conflicts,
            fix="declare the order in schedule.order, or another rule for conflicts",
        )
    if is_parallel and schedule.order in ORDERED and schedule.conflicts == "joint rule":
        yield (at / "order").error(
            "in a tick with a joint rule for conflicts, an order of acting decides nothing",
            expected='"none"',
            actual=schedule.order,
            fix='write order = "none"; or conflicts = "ordered" where the order decides',
        )
    if schedule.order in CHANGING and _acts_alone(contract):
        yield (at / "order").error(
            "each stage has one agent, which leaves no order to change",
            expected='"fixed", or "none"',
            actual=schedule.order,
            fix='write order = "fixed"; or put the roles that act in a changing order into one '
            "stage",
        )


def _acts_alone(contract: Contract) -> bool:
    """Tells whether every stage is declared to hold one agent."""
    stages = contract.schedule.stages or ()
    return bool(stages) and all(
        len(stage) == 1 and is_single(contract.roles[stage[0]]) for stage in stages
    )


def _symmetry_mistakes(contract: Contract, at: SourcePath) -> Iterator[GamekeeperError]:
    """Roles that are interchangeable, though the first of them has always what several want."""
    schedule = contract.schedule
    if (schedule.order, schedule.conflicts) != ("fixed", "ordered"):
        return
    for name, role in contract.roles.items():
        if role.symmetric and not is_single(role):
            yield (at / name / "symmetric").error(
                f"agents of role {name!r} aren't interchangeable: in a fixed order the same one "
                "comes first, and the first wins a conflict",
                expected="false",
                actual=role.symmetric,
                fix="write symmetric = false; or another schedule.order or schedule.conflicts",
            )


def _time_limit_mistakes(ending: Ending, at: SourcePath) -> Iterator[GamekeeperError]:
    """Yields an error for an ending at the horizon that isn't the truncation of all agents."""
    for key, value, right in (("kind", ending.kind, "truncation"), ("owner", ending.owner, "all")):
        if value not in (None, right):
            yield (at / key).error(
                "schedule.horizon truncates all agents, and the ending 'horizon' says otherwise",
                expected=f'"{right}"',
                actual=value,
                fix=f'write {key} = "{right}"; or give the ending another name, or leave '
                "schedule.horizon out",
            )


def _term_mistakes(
    term: RewardTerm, roles: Mapping[str, Role], at: SourcePath
) -> Iterator[GamekeeperError]:
    for key, extra in (("earner", ("all",)), ("payee", ("all", "earner"))):
        names: tuple[str, ...] = getattr(term, key) or ()
        for number, name in enumerate(names):
            place = at / key / number if len(names) > 1 else at / key
            yield from _undeclared(place, name, (*extra, *roles))
        if len(names) > 1 and set(names) & set(extra):
            yield (at / key).error(
                f"'{at.text}.{key}' names roles beside a word for all of them",
                expected="roles, or one of " + ", ".join(extra),
                actual=list(names),
                fix="leave one out",
            )
    payees = term.payee or ()
    one = payees == ("earner",) or (len(payees) == 1 and is_single(roles.get(payees[0], Role())))
    if term.kind == "zero-sum" and one:
        yield (at / "payee").error(
            f"the zero-sum term {at.path[-1]!r} has one payee, so it always pays 0",
            expected="two payees or more, or all",
            actual=list(payees),
            fix='write payee = "all", or another kind',
        )
    if term.kind == "shared" and payees == ("earner",):
        yield (at / "payee").error(
            f"the shared term {at.path[-1]!r} pays only the agent that earned it",
            expected="roles, or all",
            actual="earner",
            fix='write kind = "individual", or payee = "all"',
        )
    if term.kind == "individual" and payees == ("all",) and term.earner not in (None, ("all",)):
        yield (at / "payee").error(
            f"the individual term {at.path[-1]!r} pays agents that didn't earn it",
            expected="the role that earns it, or earner",
            actual="all",
            fix='write kind = "shared", or payee = "earner"',
        )
