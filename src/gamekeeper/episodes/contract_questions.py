"""Questions that a contract leaves open, by key: every one has an answer that can be written."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
from gymnasium import spaces

from gamekeeper.contract import Contract, Role
from gamekeeper.contract.failure import MEASURED
from gamekeeper.contract.sections import (
    APIS,
    CONFLICTS,
    ENDING_KINDS,
    ILLEGAL,
    KINDS,
    NONE,
    OBSERVE,
    ORDERS,
    frozen,
    is_single,
    plain,
)
from gamekeeper.contract.toml import Question, value_text
from gamekeeper.episodes.agent_spec import AgentSpec, as_action

TRUTH: Final = (True, False)
LARGEST: Final = 16
"""Numbers of an action that an example of a noop has at most."""
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
        *_about_ends(contract),
    )


def _asked(
    declared: object,
    path: tuple[str, ...],
    ask: str,
    answer: str | Sequence[object],
    hint: str = "",
    lines: tuple[str, ...] = (),
    example: str = "",
) -> Iterator[Question]:
    """Yields the question of a key, unless its value is declared.

    Args:
        answer: its form, or all possible answers, of which the first is the example.
    """
    if declared is not None:
        return
    if not isinstance(answer, str):
        options = [value_text(option) for option in answer]
        answer, example = " | ".join(options), example or options[0]
    yield Question(path, ask, answer, hint=hint, lines=lines, example=example)


def _about_task(contract: Contract, parallelizable: bool | None) -> Iterator[Question]:
    yield from _asked(contract.name, ("name",), "what is the environment called?", '"NAME_v0"')
    ask = "does each tick ask all agents at once (parallel), or one after the other (aec)?"
    yield from _asked(contract.api, ("api",), ask, APIS)
    how = {"parallel": "all at once", "aec": "one after the other"}.get(contract.api or "")
    hint = ""
    if contract.api == "aec" and parallelizable is not None:
        hint = f"it calls itself {'' if parallelizable else 'not '}parallelizable"
    yield from _asked(
        contract.why, ("why",), f"why do agents act {how or 'in this way'}?", '"…"', hint
    )


def _about_schedule(contract: Contract) -> Iterator[Question]:
    schedule, roles = contract.schedule, list(contract.roles)
    yield from _asked(
        schedule.stages,
        ("schedule", "stages"),
        "which roles act together, and which groups of roles after one another?",
        "[[ROLE, …], …]",
        f"the roles are {', '.join(map(value_text, roles))}" if roles else "",
        example=value_text([roles or ["ROLE"]]),
    )
    ask = "in which order do agents of one stage act?"
    hint = '"none": simultaneously'
    yield from _asked(schedule.order, ("schedule", "order"), ask, ORDERS, hint)
    if contract.api != "parallel":
        ask = "do observations show what was after each turn, or after the whole tick?"
        yield from _asked(schedule.observe, ("schedule", "observe"), ask, OBSERVE)
    ask = "what settles actions that exclude each other?"
    yield from _asked(schedule.conflicts, ("schedule", "conflicts"), ask, CONFLICTS)
    if not contract.endings:
        ask, hint = "after how many ticks is an episode truncated?", "leave it out if it never is"
        yield from _asked(schedule.horizon, ("schedule", "horizon"), ask, "N", hint, example="100")


def _about_role(name: str, role: Role, specs: tuple[AgentSpec, ...]) -> Iterator[Question]:
    spec = next((spec for spec in specs if spec.role == name), AgentSpec(name=name, role=name))

    def ask(
        key: str, text: str, answer: str | Sequence[object], hint: str = "", example: str = ""
    ) -> Iterator[Question]:
        path = ("roles", name, key)
        return _asked(getattr(role, key), path, text, answer, hint, example=example)

    if not is_single(role):
        yield from ask("symmetric", f"are the agents of role '{name}' interchangeable?", TRUTH)
    yield from ask("may_join", f"may an agent of role '{name}' appear after reset?", TRUTH)
    yield from ask("may_leave", f"may an agent of role '{name}' leave without having ended?", TRUTH)
    answer, hint = _noop_answer(spec.action_space)
    text = f"which action of role '{name}' does nothing?"
    yield from ask("noop", text, answer, hint, _noop_example(spec.action_space))
    places = ("infos.action_mask", "observation.action_mask", NONE)
    yield from ask("mask", f"where is role '{name}' told its legal actions?", places)
    yield from ask(
        "messages", f"which fields of role '{name}' carry messages?", '["…"]', hint="[]: none"
    )
    if role.mask not in (None, NONE):
        yield from ask("illegal", f"what does an illegal action of role '{name}' do?", ILLEGAL)


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


def _noop_example(space: object) -> str:
    """The zeros of a space that has few numbers; "none" where they are no action, or many."""
    if not isinstance(space, spaces.Space):
        return value_text(NONE)
    try:
        zeros = frozen(_zeros(space))
        as_action(space, zeros)
    except (TypeError, ValueError):
        return value_text(NONE)
    return value_text(plain(zeros))


def _zeros(space: object) -> object:
    """Zeros, or the least numbers of a Discrete or MultiDiscrete.

    Raises:
        ValueError: the space has too many numbers for a line, or none.
    """
    if isinstance(space, spaces.Dict):
        return {key: _zeros(inner) for key, inner in space.items()}
    if isinstance(space, spaces.Tuple):
        return [_zeros(inner) for inner in space]
    if isinstance(space, spaces.Discrete):
        return int(space.start)
    if not isinstance(space, spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        raise ValueError(space)
    if np.prod(space.shape or ()) > LARGEST:
        raise ValueError(space)
    least = space.start if isinstance(space, spaces.MultiDiscrete) else np.zeros(space.shape)
    return np.asarray(least, space.dtype).tolist()


def _about_pay(contract: Contract) -> Iterator[Question]:
    yield from _asked(
        contract.roles or None,
        ("roles", "ROLE"),
        "which roles are there, and which agents hold each?",
        '{ agents = "…" }',
        lines=("[roles.ROLE]", 'agents = "ROLE_*"'),
    )
    yield from _asked(
        contract.rewards or None,
        ("rewards", "TERM"),
        "which terms make up the reward, who earns each, and who is paid?",
        "{ kind = …, earner = …, payee = … }",
        lines=TERM_LINES,
    )
    for name, term in contract.rewards.items():
        path = ("rewards", name)
        ask = f"is the reward term '{name}' paid to each alone, equally to all, or as a zero sum?"
        yield from _asked(term.kind, (*path, "kind"), ask, KINDS)
        ask = f"whose doing brings the reward term '{name}'?"
        yield from _asked(term.earner, (*path, "earner"), ask, ("all", *contract.roles))
        ask = f"who is paid the reward term '{name}'?"
        earner = ("earner",) if term.kind in (None, "individual") else ()
        yield from _asked(term.payee, (*path, "payee"), ask, (*earner, "all", *contract.roles))


def _about_ends(contract: Contract) -> Iterator[Question]:
    """Asks how agents end, if that is reproducible, and when an episode has failed."""
    yield from _asked(
        contract.endings or None,
        ("endings", "REASON"),
        "what ends an agent, and what ends them all?",
        "{ kind = …, owner = … }",
        lines=ENDING_LINES,
    )
    for name, ending in contract.endings.items():
        path = ("endings", name)
        yield from _asked(ending.kind, (*path, "kind"), f"what is '{name}'?", ENDING_KINDS)
        owners = ("agent", "all", *contract.roles)
        yield from _asked(ending.owner, (*path, "owner"), f"whom does '{name}' end?", owners)
    ask = "do the same seed and actions always give the same rollout?"
    yield from _asked(contract.seeds.deterministic, ("seeds", "deterministic"), ask, TRUTH)
    measured = [*MEASURED, *contract.rewards, *contract.infos]
    for scope, condition in contract.failure.items():
        for name in sorted({name.rpartition(".")[2] for name in condition.names} - {*measured}):
            yield Question(
                ("infos", name),
                f"what measures '{name}', which failure.{scope} asks for?",
                "{ dtype = …, shape = [] }",
                hint=f"an info or a reward term; known are {', '.join(measured)}",
                example='{ dtype = "float64", shape = [] }',
            )
    ask, hint = "when has the team failed an episode?", 'a condition, as "deliveries < 3"'
    yield from _asked(
        contract.failure or None, ("failure", "team"), ask, '"…"', hint, example='"return < 1"'
    )
