"""Plan of a new task: answers of `gamekeeper new`, checked, and the API that fits."""

import keyword
import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from gamekeeper.contract.sections import ENDING_KINDS, KINDS, RESERVED, Plain
from gamekeeper.errors import SpecError

WORD: Final = re.compile(r"[a-z][a-z0-9_]*")
TAKEN: Final = frozenset(
    {"gamekeeper", "gymnasium", "numpy", "pettingzoo", "pytest", "test", "tests"}
)
"""Modules that a written package and its tests import, and their folder."""
FORMS: Final = {"discrete": 1, "box": None, "multidiscrete": None, "multibinary": 1}
"""Kinds of spaces, and the number of sizes that each takes; None: one or more."""
CLASSES: Final = {
    "box": "Box",
    "discrete": "Discrete",
    "multibinary": "MultiBinary",
    "multidiscrete": "MultiDiscrete",
}
"""Class in Gymnasium by kind of space."""
FORM_TEXT: Final = "discrete:N, box:N, box:NxM, multidiscrete:N,M or multibinary:N"
LARGEST: Final = 100_000
"""Most numbers in a space, and agents in a role; more is a typing error."""
HORIZON: Final = "horizon"


@dataclass(frozen=True, slots=True)
class Form:
    """A space: `discrete:5`, `box:3x3`, `multidiscrete:3,2`, `multibinary:4`."""

    kind: str
    sizes: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.kind}:{('x' if self.kind == 'box' else ',').join(map(str, self.sizes))}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of its values."""
        if self.kind == "discrete":
            return ()
        return (len(self.sizes),) if self.kind == "multidiscrete" else self.sizes

    @property
    def noop(self) -> Plain:
        """The action that does nothing: 0, or zeros in its shape."""
        zero: Plain = 0.0 if self.kind == "box" else 0
        for size in reversed(self.shape):
            zero = (zero,) * size
        return zero

    def code(self, low: str) -> str:
        """Python for the space; a Box reaches from `low` to 1."""
        if self.kind == "box":
            return f"Box({low}, 1.0, {self.sizes}, np.float32)"
        sizes = list(self.sizes) if self.kind == "multidiscrete" else self.sizes[0]
        return f"{CLASSES[self.kind]}({sizes})"


@dataclass(frozen=True, slots=True)
class RolePlan:
    """A role, whose agents are named `name_0`, `name_1`, ..."""

    name: str
    count: int
    observes: Form = Form("box", (4,))
    acts: Form = Form("discrete", (3,))

    @property
    def agents(self) -> list[str]:
        """Names of its agents."""
        return [f"{self.name}_{number}" for number in range(self.count)]


@dataclass(frozen=True, slots=True)
class TermPlan:
    """A reward term, as in a contract."""

    name: str
    kind: str = "shared"
    earner: str = "all"
    payee: str = "all"


@dataclass(frozen=True, slots=True)
class EndingPlan:
    """A reason to end, as in a contract."""

    name: str
    kind: str = "termination"
    owner: str = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A whole task.

    Args:
        roles: in the order in which they act.
        stages: roles that act together, group after group.
        order: within a group: none, fixed, rotating, state, random.
        observe: `after tick` or `after turn`.
        conflicts: rule for actions that exclude each other.
        api: `aec` or `parallel`.
        endings: without the time limit.
    """

    name: str
    roles: tuple[RolePlan, ...]
    stages: tuple[tuple[str, ...], ...]
    order: str
    observe: str
    conflicts: str
    api: str
    why: str
    terms: tuple[TermPlan, ...]
    endings: tuple[EndingPlan, ...]
    horizon: int

    def __post_init__(self) -> None:
        _check_stages(self.stages, [role.name for role in self.roles])
        known = {role.name for role in self.roles}
        for term in self.terms:
            _check_owner(f"{term.name}: earner", term.earner, {"all", *known})
            _check_owner(f"{term.name}: payee", term.payee, {"all", "earner", *known})
            self._check_payee(term)
        for ending in self.endings:
            _check_owner(f"{ending.name}: owner", ending.owner, {"all", "agent", *known})

    def of(self, owner: str) -> list[str]:
        """The agents of a role, or all."""
        return [a for role in self.staged if owner in ("all", role.name) for a in role.agents]

    def count_of(self, stage: Sequence[str]) -> int:
        """Number of agents that act in a stage."""
        return sum(len(self.of(role)) for role in stage)

    def _check_payee(self, term: TermPlan) -> None:
        """Refuses an individual term of another payee, and a zero-sum one without its earner."""
        where = f"{term.name}: payee"
        if term.kind == "individual" and term.payee not in ("earner", term.earner):
            raise _misread(where, "earner: an individual term is paid to its earner", term.payee)
        if term.kind == "zero-sum" and (
            term.payee not in ("all", term.earner) or len(self.of(term.payee)) < 2
        ):
            raise _misread(where, "two agents or more, the earner among them", term.payee)

    @property
    def is_buffered(self) -> bool:
        """Actions of an AEC environment are put aside, as others must not observe them yet."""
        return self.api == "aec" and (self.order == "none" or self.observe == "after tick")

    @property
    def waits_for_stage(self) -> bool:
        """They are put aside until the stage has acted; else until all have."""
        return self.is_buffered and self.observe == "after turn"

    @property
    def has_gate(self) -> bool:
        """Actions exclude each other, so that a rule must settle it."""
        return self.conflicts != "joint rule"

    @property
    def class_name(self) -> str:
        """The name of the class: `MyTask` for `my_task`."""
        return "".join(part.capitalize() for part in self.name.split("_"))

    @property
    def staged(self) -> tuple[RolePlan, ...]:
        """The roles in the order of their stages."""
        by_name = {role.name: role for role in self.roles}
        return tuple(by_name[name] for stage in self.stages for name in stage)

    @property
    def agents(self) -> list[str]:
        """Every agent, in the order of the stages."""
        return [agent for role in self.staged for agent in role.agents]


def package_name(text: str) -> str:
    """The name of a package from a typed one: `my_task` for `my-task`.

    Raises:
        SpecError: Python can't import a package of that name, or the name is in use.
    """
    name = text.strip().replace("-", "_")
    taken = keyword.iskeyword(name) or name in sys.stdlib_module_names
    if taken or name in TAKEN or not WORD.fullmatch(name):
        raise SpecError(
            "a package can't have this name",
            where="NAME",
            expected="small letters, digits and _, as my_task; no keyword or module in use",
            actual=repr(text),
            fix="name another one, such as my_task",
        )
    return name


def read_roles(texts: Iterable[str]) -> tuple[RolePlan, ...]:
    """Roles from `picker=2`, or `picker` for one agent.

    Raises:
        SpecError: one of them isn't of that form, or stands there twice.
    """
    roles: dict[str, RolePlan] = {}
    for text in texts:
        name, _, number = text.partition("=")
        name = _word(name, "--agents", text)
        count = _number(number or "1", "--agents", text, most=LARGEST)
        if name in roles or name in RESERVED or name.rpartition("_")[2].isdigit():
            raise _misread("--agents", "a role of its own name, without a number", text)
        roles[name] = RolePlan(name, count)
    if not roles:
        raise _misread("--agents", "one role or more", "none")
    return tuple(roles.values())


def read_stages(text: str) -> tuple[tuple[str, ...], ...]:
    """Groups that act together: `picker+carrier`, or after one another: `picker,carrier`.

    Raises:
        SpecError: a group has no role.
    """
    stages = tuple(tuple(role.strip() for role in group.split("+")) for group in text.split(","))
    if not all(role for stage in stages for role in stage):
        raise _misread("--stages", "roles joined by + and ,", text)
    return stages


def read_form(text: str, option: str) -> Form:
    """A space, as `discrete:5`.

    Raises:
        SpecError: it isn't of that form.
    """
    kind, _, rest = text.strip().lower().partition(":")
    if kind not in FORMS:
        raise _misread(option, FORM_TEXT, text)
    parts = [part for part in re.split(r"[x,]", rest) if part]
    sizes = tuple(_number(part, option, text, most=LARGEST) for part in parts)
    least = 2 if kind in ("discrete", "multidiscrete") else 1
    fits = bool(sizes) and min(sizes) >= least and math.prod(sizes) <= LARGEST
    if not fits or FORMS[kind] not in (None, len(sizes)):
        raise _misread(option, FORM_TEXT, text)
    return Form(kind, sizes)


def with_forms(
    roles: Sequence[RolePlan], *, observes: Iterable[str] = (), acts: Iterable[str] = ()
) -> tuple[RolePlan, ...]:
    """The roles with spaces from `ROLE=SPACE`, or `SPACE` for all roles.

    Raises:
        SpecError: a space can't be read, or there is no such role.
    """
    seen = _forms(roles, observes, "--observes")
    done = _forms(roles, acts, "--acts")
    return tuple(
        replace(
            role, observes=seen.get(role.name, role.observes), acts=done.get(role.name, role.acts)
        )
        for role in roles
    )


def read_terms(texts: Iterable[str]) -> tuple[TermPlan, ...]:
    """Reward terms from `delivery=shared:carrier:all`: kind, earner, payee, all optional.

    Raises:
        SpecError: one of them isn't of that form, or stands there twice.
    """
    terms: dict[str, TermPlan] = {}
    for text in texts:
        name, parts = _parts(text, "--reward", most=3)
        kind, earner = parts[0] or "shared", parts[1] or "all"
        payee = parts[2] or ("earner" if kind == "individual" else "all")
        if kind not in KINDS or name in terms or name == "after_end":
            raise _misread("--reward", f"NAME=KIND:EARNER:PAYEE, KIND of {', '.join(KINDS)}", text)
        terms[name] = TermPlan(name, kind, earner, payee)
    if not terms:
        raise _misread("--reward", "one reward term or more", "none")
    return tuple(terms.values())


def read_endings(texts: Iterable[str]) -> tuple[EndingPlan, ...]:
    """Endings from `battery=truncation:agent`: kind and owner, both optional.

    Raises:
        SpecError: one of them isn't of that form, or stands there twice.
    """
    endings: dict[str, EndingPlan] = {}
    for text in texts:
        name, parts = _parts(text, "--ending", most=2)
        kind = parts[0] or "termination"
        if kind not in ENDING_KINDS or name in endings or name == HORIZON:
            kinds = ", ".join(ENDING_KINDS)
            raise _misread("--ending", f"NAME=KIND:OWNER, KIND of {kinds}; not {HORIZON}", text)
        endings[name] = EndingPlan(name, kind, parts[1] or "all")
    if not endings:
        raise _misread("--ending", "one ending or more", "none")
    return tuple(endings.values())


def _forms(roles: Sequence[RolePlan], texts: Iterable[str], option: str) -> Mapping[str, Form]:
    names = [role.name for role in roles]
    found: dict[str, Form] = {}
    for text in texts:
        role, equals, rest = text.rpartition("=")
        if equals and role.strip() not in names:
            raise _misread(option, f"[ROLE=]SPACE, ROLE of {', '.join(names)}", text)
        form = read_form(rest, option)
        found.update(dict.fromkeys([role.strip()] if equals else names, form))
    return found


def _check_stages(stages: Sequence[Sequence[str]], roles: Sequence[str]) -> None:
    staged = [name for stage in stages for name in stage]
    if sorted(staged) != sorted(roles):
        raise _misread("--stages", f"each of {', '.join(roles)} once", ", ".join(staged))


def _check_owner(where: str, owner: str, known: Iterable[str]) -> None:
    if owner not in known:
        raise _misread(where, f"one of {', '.join(sorted(known))}", owner)


def _parts(text: str, option: str, *, most: int) -> tuple[str, list[str]]:
    """Splits a name from the parts behind its =, which colons separate; missing ones are empty."""
    name, _, rest = text.partition("=")
    parts = [part.strip() for part in rest.split(":")]
    if len(parts) > most:
        raise _misread(option, f"at most {most} parts between colons", text)
    return _word(name, option, text), [*parts, *[""] * (most - len(parts))]


def _word(text: str, option: str, whole: str) -> str:
    name = text.strip()
    if not WORD.fullmatch(name) or keyword.iskeyword(name):
        raise _misread(option, "a name of small letters, digits and _", whole)
    return name


def _number(text: str, option: str, whole: str, *, most: int) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", text.strip()) or not 1 <= int(text) <= most:
        raise _misread(option, f"whole numbers from 1 to {most}", whole)
    return int(text)


def _misread(where: str, expected: str, actual: str) -> SpecError:
    return SpecError(
        "an answer can't be used",
        where=where,
        expected=expected,
        actual=repr(actual),
        fix="`gamekeeper new --help` shows the form and an example of each option",
    )
