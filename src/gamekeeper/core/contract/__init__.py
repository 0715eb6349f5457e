"""The contract: the game form of an environment as frozen data, from and to TOML."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import ClassVar, cast

from gamekeeper.core.contract.failure import Failure
from gamekeeper.core.contract.html import contract_html
from gamekeeper.core.contract.parts import (
    NONE,
    Ending,
    InfoField,
    Knob,
    Plain,
    RewardTerm,
    Role,
    Schedule,
    Seeds,
    covers,
    plain,
)
from gamekeeper.core.contract.places import NOWHERE, Place, Places
from gamekeeper.core.contract.question import Question
from gamekeeper.core.contract.read import SECTIONS, read_sections
from gamekeeper.core.contract.rules import check_rules, with_staged
from gamekeeper.core.contract.table import Table
from gamekeeper.core.contract.toml import parse_toml, write_toml

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
        ContractError: a value isn't of its kind, or a declaration contradicts another.
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
    places: Places = field(default=NOWHERE, compare=False, repr=False)

    load: ClassVar[Callable[[str | PathLike[str]], Contract]]
    """Reads a contract from a file; bound where files are read, in `game.contract_file`."""

    def __post_init__(self) -> None:
        for key, value in read_sections(self.to_json(), Place(self.places)).items():
            object.__setattr__(self, key, value)
        for key in ("roles", "rewards", "endings", "infos", "knobs", "failure", "waivers"):
            object.__setattr__(self, key, Table(getattr(self, key)))
        object.__setattr__(self, "roles", with_staged(self))
        check_rules(self)

    @classmethod
    def parse(cls, text: str, *, source: str = "<text>") -> Contract:
        """The contract that a TOML text declares.

        Args:
            text: TOML 1.0.
            source: what errors call the text.

        Raises:
            ContractError: it isn't TOML, isn't a contract, or contradicts itself; names the line.
        """
        data, places = parse_toml(text, source=source)
        return cls._of(data, places)

    @classmethod
    def from_json(cls, data: object, *, source: str = "<json>") -> Contract:
        """The contract that plain data declares, as `to_json` gave it.

        Raises:
            ContractError: it isn't a contract, or contradicts itself.
        """
        return cls._of(data, Places(source))

    @classmethod
    def _of(cls, data: object, places: Places) -> Contract:
        sections = read_sections(data, Place(places))
        return cls(**sections, places=places)  # type: ignore[arg-type]

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
        """Where the path is declared: `warehouse.toml, line 12, roles.picker.noop`."""
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
        """Where the agent's mask stands, as `infos.action_mask`; None where none is declared."""
        role = self.roles.get(self.role_of(agent) or "")
        return None if role is None or role.mask == NONE else role.mask

    def waived(self, check_id: str) -> str | None:
        """The reason why the check's findings are as they should be; None where not waived."""
        return self.waivers.get(check_id)

    def volatile_infos(self) -> frozenset[str]:
        """The fields of infos that differ between equal runs."""
        return frozenset(name for name, info in self.infos.items() if info.volatile)


def _column_name(agent: object) -> str:
    from gamekeeper.core.layout import agent_name  # here: reading a contract loads no NumPy

    return agent_name(agent)
