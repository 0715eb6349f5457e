"""The contract: the structure of an environment as frozen data, from and to TOML."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from os import PathLike, fspath
from typing import cast

from gamekeeper.contract.contradictions import check_declarations, with_staged
from gamekeeper.contract.failure import Failure
from gamekeeper.contract.file import contract_text
from gamekeeper.contract.html import contract_html
from gamekeeper.contract.reader import SECTIONS, read_sections, with_placeholders
from gamekeeper.contract.scene import Body, Cells, Scene
from gamekeeper.contract.sections import (
    NONE,
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
    plain,
)
from gamekeeper.contract.toml import Question, parse_toml, write_toml
from gamekeeper.contract.validation import (
    NOWHERE,
    SourceLines,
    SourcePath,
    can_be_told,
    mistakes_in,
    together,
)
from gamekeeper.errors import ContractError, GamekeeperError

__all__ = [
    "Body",
    "Cells",
    "Contract",
    "Ending",
    "Failure",
    "InfoField",
    "Knob",
    "Question",
    "RewardTerm",
    "Role",
    "Scene",
    "Schedule",
    "Seeds",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contract:
    """A structure that doesn't contradict itself; what is None or empty is not declared.

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
        seeds: what a seed determines.
        infos: fields of the infos by name.
        knobs: arguments that make the task harder, by name.
        scene: how a turn is drawn.
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
    scene: Scene = field(default_factory=Scene)
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
        object.__setattr__(self, "roles", with_staged(self, at))
        check_declarations(self, at)
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
    def from_json(cls, data: object) -> Contract:
        """The contract that plain data declares, as `to_json` gave it.

        Raises:
            ContractError: it isn't a contract, or contradicts itself.
        """
        return cls._of(data, SourceLines("<json>"))

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

    def volatile_infos(self) -> frozenset[str]:
        """The fields of infos that differ between equal runs."""
        return frozenset(name for name, info in self.infos.items() if info.volatile)


def _column_name(agent: object) -> str:
    """Names it as columns do: a text that UTF-8 carries by itself, anything else by its JSON."""
    is_text = isinstance(agent, str) and can_be_told(agent)
    return str(agent) if is_text else json.dumps(agent, default=str)
