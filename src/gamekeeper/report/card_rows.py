"""What stands on a card: sections of rows, said in words, without how they are laid out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from gamekeeper.core.contract import Contract, Ending, InfoField, Knob, RewardTerm, Role
from gamekeeper.core.contract.agent_spec import AgentSpec
from gamekeeper.core.contract.parts import NONE, patterns, plain
from gamekeeper.core.contract.places import one_line
from gamekeeper.core.contract.toml import value_text
from gamekeeper.report.space_text import space_text

Row = tuple[str, ...]

ORDERS: Final = {
    "none": "none: a stage acts simultaneously",
    "fixed": "fixed",
    "rotating": "rotating: the first changes from tick to tick",
    "state": "state: the state says who is next",
    "random": "random: drawn anew",
}
OBSERVE: Final = {
    "after tick": "after tick: all see what the whole tick made",
    "after turn": "after turn: each sees what the turns before it made",
}
CONFLICTS: Final = {
    "joint rule": "joint rule: free of any order",
    "priority": "priority: some agents go first",
    "random": "random: drawn",
    "ordered": "ordered: who acts first has it",
}
HORIZON: Final = "horizon"
"""What the base classes call the ending at the time limit."""
ILLEGAL: Final = {
    "error": "an illegal action is an error",
    "penalty": "an illegal action costs a penalty",
    "end": "an illegal action ends the episode",
}


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a card; rows have as many cells as the widest of them, or fewer.

    Args:
        title: what it is about.
        rows: at least one.
        head: names of the columns, where they need one.
    """

    title: str
    rows: tuple[Row, ...]
    head: Row = ()


def card_sections(contract: Contract, agents: tuple[AgentSpec, ...]) -> tuple[Section, ...]:
    """The sections that have something to say, in the order of a contract."""
    found = (
        ("Agents", _agents(agents), ("name", "role", "observes", "acts")),
        ("Roles", ((name, _role(name, role)) for name, role in contract.roles.items()), ()),
        ("Schedule", _schedule(contract), ()),
        ("Rewards", _rewards(contract), ()),
        ("Endings", _endings(contract), ()),
        ("Seeds", _seeds(contract), ()),
        ("Infos", ((name, _info(field)) for name, field in contract.infos.items()), ()),
        ("Knobs", ((name, _knob(knob)) for name, knob in contract.knobs.items()), ()),
        ("Failure", ((name, rule.text) for name, rule in contract.failure.items()), ()),
        ("Waivers", contract.waivers.items(), ()),
    )
    made = ((title, tuple(_cleaned(rows)), head) for title, rows, head in found)
    return tuple(Section(title, rows, head) for title, rows, head in made if rows)


def _cleaned(rows: Iterable[Row]) -> Iterator[Row]:
    for row in rows:
        yield tuple(one_line(cell) for cell in row)


def _agents(agents: tuple[AgentSpec, ...]) -> Iterator[Row]:
    """A row for each run of agents that are told and may do the same."""
    for _, alike in groupby(agents, key=lambda spec: (spec.role, _observes(spec), _acts(spec))):
        group = list(alike)
        names = ", ".join(spec.name for spec in group)
        if len(group) > 2:
            names = f"{group[0].name} to {group[-1].name} ({len(group)})"
        first = group[0]
        yield names, first.role or "no role", _observes(first), _acts(first)


def _observes(spec: AgentSpec) -> str:
    return space_text(spec.observation_space)


def _acts(spec: AgentSpec) -> str:
    return space_text(spec.action_space)


def _role(name: str, role: Role) -> str:
    says = [" or ".join(patterns(name, role)) if role.agents else "agents called like it"]
    if role.symmetric is not None:
        says.append("interchangeable" if role.symmetric else "not interchangeable")
    if role.may_join is not None:
        says.append("may join" if role.may_join else "all there from the start")
    if role.may_leave is not None:
        says.append("may leave" if role.may_leave else "stay until they end")
    if role.noop is not None:
        says.append("always does something" if role.noop == NONE else f"noop {_value(role.noop)}")
    if role.mask is not None:
        says.append("every action is legal" if role.mask == NONE else f"mask in {role.mask}")
    if role.messages is not None:
        said = ", ".join(role.messages)
        says.append(f"messages in {said}" if said else "no messages")
    if role.illegal is not None:
        says.append(ILLEGAL[role.illegal])
    return "; ".join(says)


def _schedule(contract: Contract) -> Iterator[Row]:
    schedule = contract.schedule
    if schedule.stages is not None:
        yield "stages", ", then ".join(" with ".join(stage) for stage in schedule.stages)
    if schedule.order is not None:
        yield "order", ORDERS[schedule.order]
    if schedule.observe is not None:
        yield "observe", OBSERVE[schedule.observe]
    if schedule.conflicts is not None:
        yield "conflicts", CONFLICTS[schedule.conflicts]


def _rewards(contract: Contract) -> Iterator[Row]:
    for name, term in contract.rewards.items():
        yield name, _term(term)
    if contract.after_end is not None:
        yield "after the end", f"pay is {contract.after_end}"


def _term(term: RewardTerm) -> str:
    says = [term.kind]
    if term.earner is not None:
        says.append(f"earned by {' and '.join(term.earner)}")
    if term.payee is not None:
        who = "the earner" if term.payee == ("earner",) else " and ".join(term.payee)
        says.append(f"paid to {who}")
    return ", ".join(says)


def _endings(contract: Contract) -> Iterator[Row]:
    """Every ending; the horizon once, whether it is named among them, scheduled, or both."""
    ticks = contract.schedule.horizon
    limit = "" if ticks is None else f"after {ticks} ticks: "
    for name, ending in contract.endings.items():
        yield name, (limit if name == HORIZON else "") + _ending(ending)
    if limit and HORIZON not in contract.endings:
        yield HORIZON, f"{limit}truncation, of all"


def _ending(ending: Ending) -> str:
    owners = {None: "", "agent": ", of the one agent", "all": ", of all"}
    return ending.kind + owners.get(ending.owner, f", of all of role {ending.owner}")


def _seeds(contract: Contract) -> Iterator[Row]:
    if contract.seeds.deterministic is not None:
        same = "the same" if contract.seeds.deterministic else "not always the same"
        yield "deterministic", f"equal seeds and actions give {same} rollout"


def _info(info: InfoField) -> str:
    says = [info.dtype or "any type"]
    if info.shape is not None:
        says.append(f"shape {list(info.shape)}" if info.shape else "one value")
    if info.volatile is not None:
        says.append("differs between equal runs" if info.volatile else "the same in equal runs")
    return ", ".join(says)


def _knob(knob: Knob) -> str:
    return knob.label + ("" if knob.ideal is None else f", ideally {_value(knob.ideal)}")


def _value(value: object) -> str:
    return value_text(plain(value))
