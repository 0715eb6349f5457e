"""What a contract leaves open, asked by name: every question has an answer that can be written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from gymnasium import spaces

from gamekeeper.core.contract import Contract, Role
from gamekeeper.core.contract.agent_spec import AgentSpec
from gamekeeper.core.contract.parts import (
    APIS,
    CONFLICTS,
    ILLEGAL,
    NONE,
    OBSERVE,
    ORDERS,
    is_single,
)
from gamekeeper.core.contract.question import Question
from gamekeeper.core.contract.toml import key_text, value_text

TRUTH: Final = "true | false"
TERM_LINES: Final = (
    "[rewards.TERM]",
    'kind = "individual"        # or "shared", "zero-sum"',
    'earner = "ROLE"            # or "all"',
    'payee = "earner"           # or a role, or "all"',
)
ENDING_LINES: Final = (
    'REASON = { kind = "termination", owner = "agent" }     # or "truncation"; "all" or a role',
)


def open_questions(
    contract: Contract, agents: Iterable[AgentSpec] = (), *, parallelizable: bool | None = None
) -> tuple[Question, ...]:
    """The questions whose answers the contract lacks, in the order of its keys.

    Args:
        contract: as far as it is declared.
        agents: their spaces make the questions more exact.
        parallelizable: what an AEC environment says of itself in its metadata.
    """
    specs = tuple(agents)
    return (
        *_about_task(contract, parallelizable),
        *_about_schedule(contract),
        *(q for name, role in contract.roles.items() for q in _about_role(name, role, specs)),
        *_about_pay(contract),
    )


def _words(options: Iterable[str]) -> str:
    return " | ".join(map(value_text, options))


def _about_task(contract: Contract, parallelizable: bool | None) -> Iterator[Question]:
    if contract.name is None:
        yield Question(("name",), "what is the environment called?", '"NAME_v0"')
    if contract.api is None:
        ask = "does each tick ask all agents at once (parallel), or one after the other (aec)?"
        yield Question(("api",), ask, _words(APIS))
    if contract.why is None:
        how = {"parallel": "all at once", "aec": "one after the other"}.get(contract.api or "")
        hint = ""
        if contract.api == "aec" and parallelizable is not None:
            hint = f"it calls itself {'' if parallelizable else 'not '}parallelizable"
        yield Question(("why",), f"why do agents act {how or 'in this way'}?", '"…"', hint=hint)


def _about_schedule(contract: Contract) -> Iterator[Question]:
    schedule, roles = contract.schedule, list(contract.roles)
    if schedule.stages is None:
        known = ", ".join(map(value_text, roles))
        yield Question(
            ("schedule", "stages"),
            "which roles act together, and which groups of roles after one another?",
            "[[ROLE, …], …]",
            hint=f"the roles are {known}" if roles else "",
        )
    if schedule.order is None:
        ask = "in which order do agents of one stage act?"
        yield Question(("schedule", "order"), ask, _words(ORDERS), hint='"none": simultaneously')
    if schedule.observe is None and contract.api != "parallel":
        ask = "do observations show what was after each turn, or after the whole tick?"
        yield Question(("schedule", "observe"), ask, _words(OBSERVE))
    if schedule.conflicts is None:
        ask = "what settles actions that exclude each other?"
        yield Question(("schedule", "conflicts"), ask, _words(CONFLICTS))
    if schedule.horizon is None and not contract.endings:
        ask = "after how many ticks is an episode truncated?"
        yield Question(("schedule", "horizon"), ask, "N", hint="leave it out if it never is")


def _about_role(name: str, role: Role, specs: tuple[AgentSpec, ...]) -> Iterator[Question]:
    spec = next((spec for spec in specs if spec.role == name), AgentSpec(name=name, role=name))

    def ask(key: str, text: str, answer: str, hint: str = "") -> Iterator[Question]:
        if getattr(role, key) is None:
            yield Question(("roles", name, key), text, answer, hint=hint)

    if not is_single(role):
        yield from ask("symmetric", f"are the agents of role '{name}' interchangeable?", TRUTH)
    yield from ask("may_join", f"may an agent of role '{name}' appear after reset?", TRUTH)
    yield from ask("may_leave", f"may an agent of role '{name}' leave without having ended?", TRUTH)
    yield from ask(
        "noop", f"which action of role '{name}' does nothing?", *_noop_answer(spec.action_space)
    )
    places = _words(("infos.action_mask", "observation.action_mask", NONE))
    yield from ask("mask", f"where is role '{name}' told its legal actions?", places)
    yield from ask(
        "messages", f"which fields of role '{name}' carry messages?", '["…"]', hint="[]: none"
    )
    if role.mask not in (None, NONE):
        yield from ask(
            "illegal", f"what does an illegal action of role '{name}' do?", _words(ILLEGAL)
        )


def _noop_answer(space: object) -> tuple[str, str]:
    """The form of a noop of the space, and what it can be."""
    if isinstance(space, spaces.Discrete):
        first = int(space.start)
        return "N", f'N in {first} to {first + int(space.n) - 1}; "none": no action does'
    if isinstance(space, spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        shape = " by ".join(str(length) for length in space.shape or ()) or "one"
        return "[N, …]", f'{shape} numbers; "none": no action does'
    if isinstance(space, spaces.Dict):
        return "{ KEY = N, … }", f'keys {", ".join(map(str, space))}; "none": no action does'
    return "N", '"none": no action does'


def _about_pay(contract: Contract) -> Iterator[Question]:
    if not contract.roles:
        lines = ("[roles.ROLE]", 'agents = "ROLE_*"')
        ask = "which roles are there, and which agents hold each?"
        yield Question(("roles", "ROLE"), ask, '{ agents = "…" }', lines=lines)
    if not contract.rewards:
        ask = "which terms make up the reward, who earns each, and who is paid?"
        yield Question(
            ("rewards", "TERM"), ask, "{ kind = …, earner = …, payee = … }", lines=TERM_LINES
        )
    for name, term in contract.rewards.items():
        roles = _words((*contract.roles, "all"))
        if term.earner is None:
            ask = f"whose doing brings the reward term '{name}'?"
            yield Question(("rewards", name, "earner"), ask, roles)
        if term.payee is None:
            ask = f"who is paid the reward term '{name}'?"
            yield Question(("rewards", name, "payee"), ask, roles)
    if not contract.endings:
        ask = "what ends an agent, and what ends them all?"
        yield Question(("endings", "REASON"), ask, "{ kind = …, owner = … }", lines=ENDING_LINES)
    for name, ending in contract.endings.items():
        if ending.owner is None:
            known = _words(("agent", "all", *contract.roles))
            row = (f'{key_text(name)} = {{ kind = "{ending.kind}", owner = … }}',)
            path = ("endings", name, "owner")
            yield Question(path, f"whom does '{name}' end?", known, hint=known, lines=row)
    if contract.seeds.deterministic is None:
        ask = "do the same seed and actions always give the same rollout?"
        yield Question(("seeds", "deterministic"), ask, TRUTH)
    if "team" not in contract.failure:
        ask = "when has the team failed an episode?"
        yield Question(("failure", "team"), ask, '"…"', hint='a condition, as "deliveries < 3"')
