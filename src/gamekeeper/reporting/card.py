"""The card of an environment: its structure on one page, as text, TOML and JSON."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from gamekeeper.contract import Contract, Ending, InfoField, Knob, Question, RewardTerm, Role
from gamekeeper.contract.sections import NONE, patterns, plain
from gamekeeper.contract.toml import value_text
from gamekeeper.contract.validation import one_line
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.reporting.text_columns import column_lines, space_text, wrapped

Row = tuple[str, ...]

ORDERS: Final = {
    "none": "none: a stage acts simultaneously",
    "fixed": "fixed",
    "rotating": "rotating: the first agent changes from tick to tick",
    "state": "state: the state decides which agent is next",
    "random": "random: a new order each tick",
}
OBSERVE: Final = {
    "after tick": "after tick: all agents observe the result of the whole tick",
    "after turn": "after turn: each agent observes the result of the turns before its own",
}
CONFLICTS: Final = {
    "joint rule": "joint rule: independent of any order",
    "priority": "priority: some agents go first",
    "random": "random: settled at random",
    "ordered": "ordered: the agent that acts first wins",
}
HORIZON: Final = "horizon"
"""Name that the base classes give the ending at the time limit."""
ILLEGAL: Final = {
    "error": "an illegal action is an error",
    "penalty": "an illegal action costs a penalty",
    "end": "an illegal action ends the episode",
}


@dataclass(frozen=True, slots=True)
class CardSection:
    """A part of a card; rows have as many cells as the widest of them, or fewer.

    Args:
        rows: at least one.
        head: names of the columns, where they need one.
    """

    title: str
    rows: tuple[Row, ...]
    head: Row = ()


def card_sections(contract: Contract, agents: tuple[AgentSpec, ...]) -> tuple[CardSection, ...]:
    """The sections that aren't empty, in the order of a contract."""
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
    return tuple(CardSection(title, rows, head) for title, rows, head in made if rows)


def _cleaned(rows: Iterable[Row]) -> Iterator[Row]:
    for row in rows:
        yield tuple(one_line(cell) for cell in row)


def _agents(agents: tuple[AgentSpec, ...]) -> Iterator[Row]:
    """A row for each group of agents with the same role and spaces."""

    def cells(spec: AgentSpec) -> Row:
        spaces = spec.observation_space, spec.action_space
        return spec.role or "no role", *map(space_text, spaces)

    for shared, alike in groupby(agents, key=cells):
        group = [spec.name for spec in alike]
        are_few = len(group) < 3
        yield (
            ", ".join(group) if are_few else f"{group[0]} to {group[-1]} ({len(group)})",
            *shared,
        )


def _role(name: str, role: Role) -> str:
    parts = [" or ".join(patterns(name, role)) if role.agents else "agents named like it"]
    if role.symmetric is not None:
        parts.append("interchangeable" if role.symmetric else "not interchangeable")
    if role.may_join is not None:
        parts.append("may join" if role.may_join else "present from the start")
    if role.may_leave is not None:
        parts.append("may leave" if role.may_leave else "stay until they end")
    if role.noop is not None:
        parts.append("no noop" if role.noop == NONE else f"noop {_value(role.noop)}")
    if role.mask is not None:
        parts.append("every action is legal" if role.mask == NONE else f"mask in {role.mask}")
    if role.messages is not None:
        fields = ", ".join(role.messages)
        parts.append(f"messages in {fields}" if fields else "no messages")
    if role.illegal is not None:
        parts.append(ILLEGAL[role.illegal])
    return "; ".join(parts)


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
        yield "after the end", f"rewards are {contract.after_end} once an agent has ended"


def _term(term: RewardTerm) -> str:
    is_own, is_shared = term.payee == ("earner",), term.kind == "shared"
    is_plain = is_own if term.kind == "individual" else is_shared and term.payee is not None
    parts = [] if is_plain and term.earner else [term.kind or "kind not declared"]
    if term.earner is not None:
        parts.append(f"earned by {' and '.join(term.earner)}")
    if term.payee is not None:
        payee = "the earner" if is_own else " and ".join(term.payee)
        parts.append(f"paid to {payee}" + ", each the same" * is_shared)
    return ", ".join(parts)


def _endings(contract: Contract) -> Iterator[Row]:
    """Every ending; the horizon once, also where it is both named among them and scheduled."""
    ticks = contract.schedule.horizon
    limit = "" if ticks is None else f"after {ticks} ticks: "
    for name, ending in contract.endings.items():
        yield name, (limit if name == HORIZON else "") + _ending(ending)
    if limit and HORIZON not in contract.endings:
        yield HORIZON, f"{limit}truncation of all agents"


def _ending(ending: Ending) -> str:
    owners = {None: "", "agent": " of one agent", "all": " of all agents"}
    return (ending.kind or "kind not declared") + owners.get(
        ending.owner, f" of all agents of role {ending.owner}"
    )


def _seeds(contract: Contract) -> Iterator[Row]:
    if contract.seeds.deterministic is not None:
        same = "the same" if contract.seeds.deterministic else "not always the same"
        yield "deterministic", f"equal seeds and actions give {same} rollout"


def _info(info: InfoField) -> str:
    parts = [info.dtype or "any type"]
    if info.shape is not None:
        parts.append(f"shape {list(info.shape)}" if info.shape else "one value")
    if info.volatile is not None:
        parts.append("differs between equal runs" if info.volatile else "the same in equal runs")
    return ", ".join(parts)


def _knob(knob: Knob) -> str:
    return knob.label + ("" if knob.ideal is None else f", ideally {_value(knob.ideal)}")


def _value(value: object) -> str:
    return value_text(plain(value))


NARROWEST: Final = 40
"""Columns below which lines are not broken any more."""


def card_text(
    contract: Contract,
    agents: Iterable[AgentSpec] = (),
    *,
    width: int = 80,
    questions: Sequence[Question] | None = None,
) -> str:
    """The card as plain text without colour codes.

    Args:
        contract: the declarations.
        agents: in the order of `possible_agents`.
        width: columns that no line exceeds, at least 40.
        questions: missing declarations; None: those that the contract alone shows.
    """
    specs = tuple(agents)
    wide = max(width, NARROWEST)
    lines = [*_wrapped(_title(contract), wide, "", "  ")]
    if contract.why:
        lines += _wrapped(one_line(contract.why), wide, "  ", "  ")
    for section in card_sections(contract, specs):
        rows = [section.head, *section.rows] if section.head else section.rows
        lines += ["", section.title, *column_lines(rows, width=wide)]
    for title, group in _groups(_asked(contract, specs, questions)):
        lines += ["", f"{title} ({len(group)})"]
        for question, *alike in _by_role(group):
            why = f" (it matters: {question.why})" if question.why else ""
            so = f"; and so for {', '.join(each.path[1] for each in alike)}" if alike else ""
            text = f"{question.ask}{why} -> {_proposed(question)}{so}"
            lines += _wrapped(one_line(text), wide, "  ", "      ")
    return "\n".join(lines) + "\n"


def card_toml(
    contract: Contract,
    agents: Iterable[AgentSpec] = (),
    *,
    questions: Sequence[Question] | None = None,
) -> str:
    """The contract as TOML, its open questions standing as comments where the answers go."""
    return contract.to_toml(_asked(contract, tuple(agents), questions))


def card_json(
    contract: Contract,
    agents: Iterable[AgentSpec] = (),
    *,
    questions: Sequence[Question] | None = None,
) -> dict[str, object]:
    """The card as plain data."""
    specs = tuple(agents)
    return {
        "name": contract.name,
        "api": contract.api,
        "why": contract.why,
        "agents": [_agent_json(spec) for spec in specs],
        "contract": contract.to_json(),
        "questions": [
            {
                "key": each.key,
                "ask": each.ask,
                "answer": each.answer,
                "hint": each.hint,
                "measured": each.measured or None,
                "why": each.why or None,
            }
            for each in _asked(contract, specs, questions)
        ],
    }


def _agent_json(spec: AgentSpec) -> dict[str, object]:
    return {
        "name": spec.name,
        "role": spec.role,
        "observation_space": space_text(spec.observation_space, limit=1_000),
        "action_space": space_text(spec.action_space, limit=1_000),
    }


def _asked(
    contract: Contract, specs: tuple[AgentSpec, ...], questions: Sequence[Question] | None
) -> tuple[Question, ...]:
    return open_questions(contract, specs) if questions is None else tuple(questions)


def _groups(asked: Sequence[Question]) -> Iterator[tuple[str, list[Question]]]:
    """Questions with a measured answer, and those without, each with its title."""
    measured = [each for each in asked if each.measured]
    others = [each for each in asked if not each.measured]
    for title, group in (
        ("Measured, but not declared, so not checked", measured),
        ("Not declared, so not checked", others),
    ):
        if group:
            yield title, group


def _by_role(group: Sequence[Question]) -> Iterable[list[Question]]:
    """The questions, those together that ask the same of several roles."""
    found: dict[object, list[Question]] = {}
    for each in group:
        path = ("roles", *each.path[2:]) if each.path[0] == "roles" else each.path
        found.setdefault((path, each.answer, each.measured, each.why), []).append(each)
    return found.values()


def _proposed(question: Question) -> str:
    """The key with its measured answer, or with the form of an answer."""
    if question.measured:
        return f"{question.key} = {question.measured} (else {question.answer})"
    return f"{question.key} = {question.answer}"


def _title(contract: Contract) -> str:
    api = {"parallel": "Parallel", "aec": "AEC"}.get(contract.api or "", "API not declared")
    return one_line(f"{contract.name or 'an environment without a name'} ({api})")


def _wrapped(text: str, width: int, first: str, rest: str) -> list[str]:
    lines = wrapped(text, width, first=first, rest=rest)
    return [line.rstrip() for line in lines] or [first.rstrip()]
