"""A contract to begin with: few questions, usual values declared, the rest measured.

Declared are values that hold of nearly every environment and that the measurement doesn't speak
against. Measured values are proposed with their evidence and declare nothing before their # is
taken away: an audit judges nothing by its own measurement. Asked is what only the author knows, or
what no seed can show, each with the reason why it matters.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

from gamekeeper.contract import Contract, Question, Role
from gamekeeper.contract.toml import key_text, value_text
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.reporting.measured_text import words

Measured = Mapping[str, Any]

WHY: Final = {
    "name": "evidence and contract are matched by it",
    "api": "it decides what an audit looks at",
    "stages": "observations and conflicts are judged by who acts together",
    "order": "an order that nobody meant favors its first agent",
    "observe": "agents that see a half-finished tick learn from what others don't see",
    "conflicts": "a conflict that the order of a dictionary settles isn't a rule",
    "symmetric": "the audit exchanges such agents and compares; one network may serve them all",
    "noop": "idle turns are counted by it, and a diagnosis holds an agent still with it",
    "messages": "a diagnosis garbles them to see who listens",
    "rewards": "the audit checks who is paid; returns are told apart by term",
    "endings": "learners go on past a truncation and stop at a termination",
    "failure": "diagnose and pivots look for what made an episode fail",
    "infos": "a condition on a figure that nothing measures is never met",
    "deterministic": "replay and paired comparisons rest on it",
}
"""Reason for each question, by the last part of its key or by its section."""
OPTIONAL: Final = frozenset({"why", "mask", "illegal", "horizon"})
"""Keys that aren't asked: without them masks are looked for in the usual places, and no episode is
truncated."""
TERM: Final = ('kind = "individual"', 'earner = "ROLE"', 'payee = "earner"')


def proposal(
    contract: Contract,
    questions: Iterable[Question],
    measured: Measured,
    agents: Iterable[AgentSpec] = (),
) -> tuple[Contract, tuple[Question, ...]]:
    """The contract with defaults declared, and the questions and proposals that are left.

    Args:
        contract: as far as the environment shows it.
        questions: what it leaves open, with measured answers.
        measured: as the audit's document has it.
        agents: those that there are; of a role with one of them it isn't asked who is alike.
    """
    count = Counter(each.role for each in agents)
    roles = {name: _with_defaults(name, role, measured) for name, role in contract.roles.items()}
    seeds = contract.seeds
    if seeds.deterministic is None and measured.get("deterministic") is not False:
        seeds = replace(seeds, deterministic=True)
    filled = replace(contract, roles=roles, seeds=seeds)
    known = [*_known_terms(contract), *_known_endings(contract)]
    asked = {each.path[0] for each in known}
    left = [
        found
        for each in questions
        if each.path[0] not in asked and not _is_answered(each, filled)
        if each.path[-1] != "symmetric" or count[each.path[1]] != 1
        if (found := _left(each, measured)) is not None
    ]
    open_parts: dict[str, Any] = {section: {} for section in asked}
    return replace(filled, **open_parts), (*left, *known)


def _with_defaults(name: str, role: Role, measured: Measured) -> Role:
    """A role whose agents stay from reset to their end and send no messages, unless seen."""
    defaults: dict[str, Any] = {
        key: False
        for key in ("may_join", "may_leave")
        if getattr(role, key) is None and name not in (measured.get(key) or ())
    }
    seen = (measured.get("messages") or {}).get(name) or {}
    if role.messages is None and not seen.get("message"):
        defaults["messages"] = ()
    return replace(role, **defaults)


def _is_answered(question: Question, contract: Contract) -> bool:
    """A default has answered it, or nobody needs the answer."""
    match question.path:
        case ("roles", name, key) if name in contract.roles:
            return key in OPTIONAL or getattr(contract.roles[name], key, None) is not None
        case ("seeds", "deterministic"):
            return contract.seeds.deterministic is not None
    return question.path[-1] in OPTIONAL and not question.measured and question.path != ("why",)


def _left(question: Question, measured: Measured) -> Question | None:
    """A proposal where it was measured, else the question with its reason; `why` stays empty."""
    path = question.path
    if path == ("why",):
        text = str(measured.get("why") or "")
        ask = "why this API: your own reason"
        hint = f"measured: {text}"
        empty: dict[str, Any] = {"measured": value_text(""), "lines": ('why = ""',)}
        return replace(question, ask=ask, hint=hint, **empty) if text else None
    if path[0] == "roles" and path[-1] == "symmetric":
        found = (measured.get("symmetric") or {}).get(path[1])
        if isinstance(found, Mapping) and isinstance(found.get("seems"), bool):
            value = value_text(found["seems"])
            return replace(question, ask=f"measured: {words(found)}", hint="", measured=value)
    if question.measured:
        evidence = _evidence(path, measured)
        return replace(question, ask=f"measured: {evidence}", hint="")
    why = WHY.get(path[-1]) or WHY.get(path[0], "")
    return replace(question, why=why)


def _evidence(path: tuple[str, ...], measured: Measured) -> str:
    """Words on what a measured value rests on."""
    if path[-1] == "horizon":
        return words(measured.get("endings"))
    if path == ("schedule", "stages"):
        return str(measured.get("why") or "roles that acted in one tick")
    return "in every episode that was played"


def _known_terms(contract: Contract) -> list[Question]:
    """One question for all terms that the environment names and says nothing else of."""
    names = [name for name, term in contract.rewards.items() if term.kind is None]
    if not names or len(names) < len(contract.rewards):
        return []
    lines = [line for name in names for line in (f"[rewards.{key_text(name)}]", *TERM)]
    ask = "who earns each of these reward terms, and who is paid?"
    hint = 'kind: "individual", "shared" or "zero-sum"; earner, payee: a role or "all"'
    path = ("rewards", "TERM")
    return [Question(path, ask, "", hint=hint, lines=tuple(lines), why=WHY["rewards"])]


def _known_endings(contract: Contract) -> list[Question]:
    """One question for all endings that the environment names."""
    if not contract.endings or all(each.owner is not None for each in contract.endings.values()):
        return []
    lines = [
        f"{key_text(name)} = "
        + value_text({"kind": end.kind or "termination", "owner": end.owner or "agent"})
        for name, end in contract.endings.items()
    ]
    ask = "is each of these a rule (termination) or a limit, and whom does it end?"
    hint = 'kind: "termination" or "truncation"; owner: "agent", "all" or a role'
    path = ("endings", "REASON")
    return [Question(path, ask, "", hint=hint, lines=tuple(lines), why=WHY["endings"])]
