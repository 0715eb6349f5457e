"""The contract: the game form of an environment as frozen data, from and to TOML."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations, product
from os import PathLike, fspath
from typing import cast

from gamekeeper.contract.failure import Failure
from gamekeeper.contract.file import contract_text
from gamekeeper.contract.html import contract_html
from gamekeeper.contract.pattern import overlap
from gamekeeper.contract.reader import SECTIONS, read_sections, with_placeholders
from gamekeeper.contract.sections import (
    NONE,
    RESERVED,
    Ending,
    InfoField,
    Knob,
    Plain,
    RewardTerm,
    Role,
    Schedule,
    Seeds,
    Table,
    covers,
    is_single,
    patterns,
    plain,
)
from gamekeeper.contract.toml import Question, parse_toml, write_toml
from gamekeeper.contract.validation import (
    NOWHERE,
    SourceLines,
    SourcePath,
    can_be_told,
    mistakes_in,
    nearest,
    together,
)
from gamekeeper.errors import ContractError, GamekeeperError

__all__ = [
    "Contract",
    "Ending",
    "Failure",
    "InfoField",
    "Knob",
    "Question",
    "RewardTerm",
    "Role",
    "Schedule",
    "Seeds",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contract:
    """A game form that doesn't contradict itself; what is None or empty is not declared.

    Whatever way it is made, it is read and checked as a file would be, so dictionaries may stand
    for tables and a contract that exists is valid.

    Args:
        name: of the environment, with its version.
        api: `aec` or `parallel`, the form the task has by itself.
        why: the reason for this api.
        schedule: who acts when.
        roles: by name; one that only stands in a stage has nothing declared about it.
        rewards: terms by name; their sum is the reward.
        after_end: agents that ended are paid: `forbidden` or `allowed` (`rewards.after_end`).
        endings: by the name of their reason.
        seeds: what a seed settles.
        infos: fields of the infos by name.
        knobs: arguments that make the task harder, by name.
        failure: when a rollout failed, for the `team`, an `agent`, or a role.
        waivers: why a check's finding is as it should be, by the check's id.
        places: the lines of the text it was read from; no part of its value.

    Raises:
        ContractError: a value isn't of its kind, or a declaration contradicts another; lists all
            such places.
    """

    name: str | None = None
    api: str | None = None
    why: str | None = None
    schedule: Schedule = field(default_factory=Schedule)
    roles: Mapping[str, Role] = field(default_factory=Table)
    rewards: Mapping[str, RewardTerm] = field(default_factory=Table)
    after_end: str | None = None
    endings: Mapping[str, Ending] = field(default_factory=Table)
    seeds: Seeds = field(default_factory=Seeds)
    infos: Mapping[str, InfoField] = field(default_factory=Table)
    knobs: Mapping[str, Knob] = field(default_factory=Table)
    failure: Mapping[str, Failure] = field(default_factory=Table)
    waivers: Mapping[str, str] = field(default_factory=Table)
    places: SourceLines = field(default=NOWHERE, compare=False, repr=False)

    def __post_init__(self) -> None:
        mistakes: list[GamekeeperError] = []
        at = SourcePath(self.places, mistakes=mistakes)
        sections = read_sections(self.to_json(), at)
        if mistakes:
            raise together(mistakes, self.places)
        for key, value in sections.items():
            object.__setattr__(self, key, value)
        for key in ("roles", "rewards", "endings", "infos", "knobs", "failure", "waivers"):
            object.__setattr__(self, key, Table(getattr(self, key)))
        object.__setattr__(self, "roles", _with_staged(self, at))
        _check_declarations(self, at)
        if mistakes:
            raise together(mistakes, self.places)

    @classmethod
    def parse(cls, text: str, *, source: str = "<text>") -> Contract:
        """The contract that a TOML text declares.

        Args:
            text: TOML 1.0.
            source: what errors call the text.

        Raises:
            ContractError: it isn't TOML, isn't a contract, or contradicts itself; names the line
                of each mistake.
        """
        data, places = parse_toml(text, source=source)
        return cls._of(data, places)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Contract:
        """The contract that a TOML file declares.

        Args:
            path: a file in UTF-8.

        Raises:
            ContractError: the file can't be read, isn't TOML, isn't a contract, or contradicts
                itself; names file and line.
        """
        return cls.parse(contract_text(path), source=fspath(path))

    @classmethod
    def from_json(cls, data: object, *, source: str = "<json>") -> Contract:
        """The contract that plain data declares, as `to_json` gave it.

        Raises:
            ContractError: it isn't a contract, or contradicts itself.
        """
        return cls._of(data, SourceLines(source))

    @classmethod
    def _of(cls, data: object, places: SourceLines) -> Contract:
        mistakes: list[GamekeeperError] = []
        at = SourcePath(places, mistakes=mistakes)
        try:
            sections = read_sections(data, at)
            if mistakes:
                sections = with_placeholders(sections, data)
            contract = cls(**sections, places=places)  # type: ignore[arg-type]
        except ContractError as error:
            mistakes.extend(mistakes_in(error))
        if mistakes:
            raise together(mistakes, places)
        return contract

    def to_json(self) -> dict[str, object]:
        """Plain data: dictionaries, lists and scalars, without what isn't declared."""
        data = {key: plain(getattr(self, key)) for key in SECTIONS}
        if self.after_end is not None:
            terms = cast("dict[str, object]", data["rewards"])
            data["rewards"] = {"after_end": self.after_end, **terms}
        return {key: value for key, value in data.items() if value is not None and value != {}}

    def to_toml(self, questions: Iterable[Question] = ()) -> str:
        """TOML that `parse` reads back to an equal contract.

        Args:
            questions: stand as comments where their answers go.
        """
        return write_toml(self.to_json(), tuple(questions))

    def __str__(self) -> str:
        return self.to_toml()

    def _repr_html_(self) -> str:
        return contract_html(self.to_json())

    def __deepcopy__(self, memo: object) -> Contract:
        # It never changes, so copies of an environment share it.
        return self

    def declared(self, *path: str) -> bool:
        """Something is declared at the path: `declared("roles", "picker", "noop")`."""
        here: object = self.to_json()
        for key in path:
            if not isinstance(here, Mapping) or key not in here:
                return False
            here = here[key]
        return True

    def at(self, *path: str | int) -> str:
        """Place where the path is declared: `warehouse.toml, line 12, roles.picker.noop`."""
        return self.places.at(path)

    def role_of(self, agent: object) -> str | None:
        """The role that holds the agent, by its name in columns; None where none does."""
        name = agent if isinstance(agent, str) and agent.isascii() else _column_name(agent)
        return next((role for role, spec in self.roles.items() if covers(role, spec, name)), None)

    def noop_of(self, agent: object) -> Plain | None:
        """The action with which the agent does nothing; None where none is declared."""
        role = self.roles.get(self.role_of(agent) or "")
        return None if role is None or role.noop == NONE else role.noop

    def mask_of(self, agent: object) -> str | None:
        """Place of the agent's mask, as `infos.action_mask`; None where none is declared."""
        role = self.roles.get(self.role_of(agent) or "")
        return None if role is None or role.mask == NONE else role.mask

    def waived(self, check_id: str) -> str | None:
        """The reason why the check's findings are as they should be; None where not waived."""
        return self.waivers.get(check_id)

    def volatile_infos(self) -> frozenset[str]:
        """The fields of infos that differ between equal runs."""
        return frozenset(name for name, info in self.infos.items() if info.volatile)


def _column_name(agent: object) -> str:
    """Names it as columns do: a text that UTF-8 carries by itself, anything else by its JSON."""
    is_text = isinstance(agent, str) and can_be_told(agent)
    return str(agent) if is_text else json.dumps(agent, default=str)


def _check_declarations(contract: Contract, root: SourcePath) -> None:
    """Reports each role and knob that isn't declared, and each contradiction, where it stands."""
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
                what = f"knob {other!r} is not declared"
                root.report(place.unknown(what, other, others, noun="knob"))
    for scope in contract.failure:
        _check_known(root / "failure" / scope, scope, ("team", "agent", *contract.roles))


def _with_staged(contract: Contract, root: SourcePath) -> Table[Role]:
    """The declared roles, and those that are declared by standing in a stage alone.

    Reports each of the latter that is a declared role's name misspelt, as far as can be seen: it
    is close to a role that no stage names.
    """
    roles = dict(contract.roles)
    stages = contract.schedule.stages or ()
    unstaged = [name for name in roles if not any(name in stage for stage in stages)]
    for number, stage in enumerate(stages):
        for position, name in enumerate(stage):
            if name not in roles and nearest(name, unstaged):
                place = root / "schedule" / "stages" / number / position
                what = f"role {name!r} is not declared"
                root.report(place.unknown(what, name, unstaged, noun="role"))
            roles.setdefault(name, Role())
    return Table(roles)


def _check_known(at: SourcePath, name: str, known: Iterable[str]) -> None:
    if name not in known:
        at.report(at.unknown(f"role {name!r} is not declared", name, known, noun="role"))


def _check_roles(roles: Mapping[str, Role], at: SourcePath) -> None:
    for name in roles:
        if name in RESERVED:
            error = (at / name).error(
                f"no role can be called {name!r}",
                expected="a name of your own",
                actual=name,
                fix=f"{name!r} is a word of contracts: call the role something else",
            )
            at.report(error)
    usable = [(name, role) for name, role in roles.items() if name not in RESERVED]
    for (other, first), (name, second) in combinations(usable, 2):
        both = product(patterns(other, first), patterns(name, second))
        shared = next((pair for pair in both if overlap(*pair)), None)
        if shared is not None:
            # The line of the one that says which agents it holds, where one says nothing.
            wrong = name if second.agents or not first.agents else other
            error = (at / wrong / "agents").error(
                f"roles {other!r} and {name!r} can both hold an agent",
                expected="patterns that no name fits both of",
                actual=" and ".join(shared),
                fix="make one pattern narrower, or list its agents by name",
            )
            at.report(error)


def _check_schedule(contract: Contract, at: SourcePath) -> None:
    schedule = contract.schedule
    if contract.api == "parallel" and schedule.observe == "after turn":
        error = (at / "observe").error(
            "a parallel environment can't show anything before its tick is over",
            expected='"after tick"',
            actual=schedule.observe,
            fix='write observe = "after tick", or api = "aec"',
        )
        at.report(error)
    if schedule.order == "none" and schedule.conflicts == "ordered":
        error = (at / "conflicts").error(
            "conflicts are settled by an order of acting that there isn't",
            expected='"joint rule", "priority" or "random"',
            actual=schedule.conflicts,
            fix="declare the order in schedule.order, or another rule for conflicts",
        )
        at.report(error)


def _check_term(term: RewardTerm, roles: Mapping[str, Role], at: SourcePath) -> None:
    for key, extra in (("earner", ("all",)), ("payee", ("all", "earner"))):
        names: tuple[str, ...] = getattr(term, key) or ()
        for number, name in enumerate(names):
            place = at / key / number if len(names) > 1 else at / key
            _check_known(place, name, (*extra, *roles))
        if len(names) > 1 and set(names) & set(extra):
            error = (at / key).error(
                f"'{at.text}.{key}' names roles beside a word for all of them",
                expected="roles, or one of " + ", ".join(extra),
                actual=list(names),
                fix="leave one out",
            )
            at.report(error)
    payees = term.payee or ()
    one = payees == ("earner",) or (len(payees) == 1 and is_single(roles.get(payees[0], Role())))
    if term.kind == "zero-sum" and one:
        error = (at / "payee").error(
            f"the zero-sum term {at.path[-1]!r} has one payee, so it always pays 0",
            expected="two payees or more, or all",
            actual=list(payees),
            fix='write payee = "all", or another kind',
        )
        at.report(error)
    if term.kind == "shared" and payees == ("earner",):
        error = (at / "payee").error(
            f"the shared term {at.path[-1]!r} pays only the agent that earned it",
            expected="roles, or all",
            actual="earner",
            fix='write kind = "individual", or payee = "all"',
        )
        at.report(error)
    if term.kind == "individual" and payees == ("all",) and term.earner not in (None, ("all",)):
        error = (at / "payee").error(
            f"the individual term {at.path[-1]!r} pays agents that didn't earn it",
            expected="the role that earns it, or earner",
            actual="all",
            fix='write kind = "shared", or payee = "earner"',
        )
        at.report(error)
