"""The questions of `gamekeeper new`: answers of options, of the user, and defaults."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Protocol, TypeVar

from gamekeeper.contract.sections import APIS, CONFLICTS, ORDERS
from gamekeeper.errors import SpecError
from gamekeeper.scaffold.task_plan import (
    FORM_TEXT,
    Form,
    Plan,
    RolePlan,
    package_name,
    read_endings,
    read_form,
    read_roles,
    read_stages,
    read_terms,
    with_forms,
)
from gamekeeper.scaffold.timing import Timing, TimingAdvice, advise, check_timing

T = TypeVar("T")


class Ask(Protocol):
    """Asks a question, given its default answer and the function that reads an answer."""

    def __call__(self, question: str, answer: str, read: Callable[[str], T], /) -> T:
        """Asks until an answer can be read."""


SEES: Final = {"no": "after tick", "yes": "after turn"}
HORIZON: Final = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """Answers of the options of a command line; None and empty: not answered."""

    name: str
    agents: Sequence[str] = field(default=())
    stages: str | None = None
    sees: str | None = None
    order: str | None = None
    conflicts: str | None = None
    observes: Sequence[str] = field(default=())
    acts: Sequence[str] = field(default=())
    reward: Sequence[str] = field(default=())
    ending: Sequence[str] = field(default=())
    horizon: int | None = None
    api: str | None = None


def usual(question: str, answer: str, read: Callable[[str], T]) -> T:
    """Returns the default answer without asking."""
    return read(answer)


def plan_of(
    answers: Answers,
    ask: Ask = usual,
    *,
    advised: Callable[[TimingAdvice], None] = lambda advice: None,
) -> tuple[Plan, TimingAdvice]:
    """Returns the task that options and answers describe, and the advised API.

    Args:
        answers: answers of options; the rest is asked.
        ask: asks the user, again where an answer can't be read; `usual` takes the defaults.
        advised: is called with the advice before the API is asked for.
    Raises:
        SpecError: an answer can't be used.
        ContractError: two answers contradict each other.
    """
    name = package_name(answers.name)
    roles = _roles(answers, ask)
    stages = _stages(answers, ask, roles)
    timing = _timing(answers, ask, roles, stages)
    advice = advise(timing)
    advised(advice)
    question = "Which PettingZoo API?"
    timing = _choice(
        answers.api, ask, question, advice.api, APIS, lambda api: replace(timing, api=api)
    )
    roles = _spaces(answers, ask, roles)
    known = ", ".join(["all", *(role.name for role in roles)])
    terms = _read(
        answers.reward,
        ask,
        f"Reward terms, each NAME=KIND:EARNER:PAYEE; KIND: individual, shared, zero-sum; "
        f"EARNER, PAYEE: {known}, earner",
        "goal=shared:all:all",
        read_terms,
    )
    endings = _read(
        answers.ending,
        ask,
        f"Endings beside the time limit, each NAME=KIND:OWNER; KIND: termination, truncation; "
        f"OWNER: agent, {known}",
        "done=termination:all",
        read_endings,
    )
    horizon = answers.horizon or ask("Length of an episode, in ticks?", str(HORIZON), _whole)
    why = advice.why
    if timing.api != advice.api:
        why = f"chosen by its author; {advice.api} would fit, because {advice.why}"
    return Plan(
        name=name,
        api=timing.api or "",
        why=why,
        order=timing.order or "",
        observe=timing.observe or "",
        conflicts=timing.conflicts or "",
        roles=roles,
        stages=stages,
        terms=terms,
        endings=endings,
        horizon=horizon,
    ), advice


def _timing(
    answers: Answers, ask: Ask, roles: Sequence[RolePlan], stages: Sequence[Sequence[str]]
) -> Timing:
    """Answers on what agents observe, on their order and on conflicts, each fitting the others."""
    counts = {role.name: role.count for role in roles}
    sizes = [sum(counts.get(name, 0) for name in stage) for stage in stages]
    seen = _choice(
        answers.sees,
        ask,
        "Does an agent observe others' actions of the same round before it acts?",
        "no",
        SEES,
        lambda word: Timing(stages=stages, sizes=sizes, observe=SEES[word]),
    )
    ordered = _choice(
        answers.order,
        ask,
        "In which order do the agents of a group act? none: all at once",
        "fixed" if seen.is_seen else "none",
        ORDERS,
        lambda word: replace(seen, order=word),
    )
    return _choice(
        answers.conflicts,
        ask,
        "Which rule settles actions that exclude each other?",
        "joint rule",
        CONFLICTS,
        lambda word: replace(ordered, conflicts=word),
    )


def _roles(answers: Answers, ask: Ask) -> tuple[RolePlan, ...]:
    return _read(answers.agents, ask, "Agents: roles and how many of each", "robot=2", read_roles)


def _stages(answers: Answers, ask: Ask, roles: tuple[RolePlan, ...]) -> tuple[tuple[str, ...], ...]:
    together = "+".join(role.name for role in roles)
    if answers.stages is not None:
        return read_stages(answers.stages)
    if len(roles) == 1:
        return ((roles[0].name,),)
    question = "Which roles act together? Join them by +; a comma separates those that act later"
    names = sorted(role.name for role in roles)

    def read(text: str) -> tuple[tuple[str, ...], ...]:
        stages = read_stages(text)
        if sorted(name for stage in stages for name in stage) != names:
            raise SpecError(
                "an answer can't be used",
                expected=f"each once of {', '.join(names)}",
                actual=repr(text),
                fix=f"write {together}, or {','.join(names)}",
            )
        return stages

    return ask(question, together, read)


def _spaces(answers: Answers, ask: Ask, roles: tuple[RolePlan, ...]) -> tuple[RolePlan, ...]:
    observes, acts = list(answers.observes), list(answers.acts)
    for role in roles:
        for given, kind, form in (
            (observes, "Observation", role.observes),
            (acts, "Action", role.acts),
        ):
            if any(text.partition("=")[0] == role.name or "=" not in text for text in given):
                continue
            found = ask(f"{kind} space of a {role.name}: {FORM_TEXT}", str(form), _form)
            given.append(f"{role.name}={found}")
    return with_forms(roles, observes=observes, acts=acts)


def _form(text: str) -> Form:
    return read_form(text, "space")


def _read(
    given: Sequence[str], ask: Ask, question: str, answer: str, read: Callable[[Sequence[str]], T]
) -> T:
    """Reads the answers of an option, else those of the user, separated by spaces."""
    if given:
        return read(given)
    return ask(question, answer, lambda text: read(text.split()))


def _choice(
    given: str | None,
    ask: Ask,
    question: str,
    answer: str,
    options: Iterable[str],
    answered: Callable[[str], Timing],
) -> Timing:
    """The timing with an answer more: the option's, else the user's, or its beginning.

    Raises:
        SpecError: it is none of the options, or contradicts an answer before it.
    """
    words = list(options)

    def read(text: str) -> Timing:
        word = text.strip().lower()
        near = [word] if word in words else [each for each in words if each.startswith(word)]
        if len(near) != 1:
            raise SpecError(
                "an answer can't be used",
                expected=", ".join(words),
                actual=repr(text),
                fix="write one of these words, or its beginning",
            )
        return check_timing(answered(near[0]))

    return read(given) if given else ask(f"{question} ({', '.join(words)})", answer, read)


def _whole(text: str) -> int:
    if not text.strip().isdigit() or not 1 <= int(text) <= 10**9:
        raise SpecError(
            "an answer can't be used",
            expected="an integer from 1",
            actual=text,
            fix=f"write a number of ticks, such as {HORIZON}",
        )
    return int(text)
