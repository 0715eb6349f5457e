"""Reading a contract's sections from plain data: every key known, every section its class."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, TypeVar

from gamekeeper.core.contract import values as values
from gamekeeper.core.contract.parts import (
    AFTER_END,
    APIS,
    CONFLICTS,
    ENDING_KINDS,
    ILLEGAL,
    KINDS,
    KNOB_OF,
    OBSERVE,
    ORDERS,
    Ending,
    InfoField,
    Knob,
    RewardTerm,
    Role,
    Schedule,
    Seeds,
)
from gamekeeper.core.contract.places import Place, nearest, path_text
from gamekeeper.core.contract.table import Table
from gamekeeper.core.contract.values import Read
from gamekeeper.errors import ContractError

T = TypeVar("T")

DTYPES: Final = (
    "bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64",
    "float16", "float32", "float64", "str", "json",
)  # fmt: skip


def section(cls: Callable[..., T], readers: Mapping[str, Read[object]], *required: str) -> Read[T]:
    """Reads a table with known keys into its class."""

    def read(value: object, at: Place) -> T:
        table = at.table(value)
        for key in table:
            if key not in readers:
                raise unknown_key(at / key, readers)
        for key in required:
            if key not in table:
                raise at.error(
                    f"'{at.text}' has no '{key}'",
                    expected=", ".join(required),
                    seen=", ".join(table) or "nothing",
                    mend=f"add {path_text((*at.path, key))}",
                )
        return cls(**{key: readers[key](item, at / key) for key, item in table.items()})

    return read


def unknown_key(at: Place, known: Mapping[str, object]) -> ContractError:
    """An error for a key that its section doesn't have."""
    key = at.path[-1]
    inside = f"in [{path_text(at.path[:-1])}]" if len(at.path) > 1 else "at the top"
    near = nearest(key, known)
    return at.error(
        f"{key!r} is no key {inside} of a contract",
        expected=", ".join(known),
        seen=key,
        mend=f"write '{near}'" if near else "use a key that is listed, or leave it out",
    )


def named(item: Read[T]) -> Read[Table[T]]:
    """Reads a table whose keys are names of the author's."""

    def read(value: object, at: Place) -> Table[T]:
        rows = at.table(value).items()
        return Table({values.text(key, at / key): item(each, at / key) for key, each in rows})

    return read


STAGE: Final = values.listed(values.text, least=1)
SCHEDULE: Final = section(
    Schedule,
    {
        "stages": values.listed(lambda value, at: values.different(STAGE(value, at), at), least=1),
        "order": values.word(*ORDERS),
        "observe": values.word(*OBSERVE),
        "conflicts": values.word(*CONFLICTS),
        "horizon": values.whole(1),
    },
)
ROLE: Final = section(
    Role,
    {
        "agents": values.names,
        "symmetric": values.truth,
        "may_join": values.truth,
        "may_leave": values.truth,
        "noop": values.anything,
        "mask": values.mask,
        "messages": lambda value, at: values.different(values.listed(values.text)(value, at), at),
        "illegal": values.word(*ILLEGAL),
    },
)
TERM: Final = section(
    RewardTerm, {"kind": values.word(*KINDS), "earner": values.names, "payee": values.names}, "kind"
)
ENDING: Final = section(Ending, {"kind": values.word(*ENDING_KINDS), "owner": values.text}, "kind")
INFO: Final = section(
    InfoField,
    {
        "dtype": values.word(*DTYPES),
        "shape": values.listed(values.whole(0)),
        "volatile": values.truth,
    },
)
KNOB: Final = section(
    Knob,
    {
        "label": values.text,
        "ideal": values.anything,
        "of": values.word(*KNOB_OF),
        "worst": values.anything,
        "contains": lambda value, at: values.different(values.listed(values.text)(value, at), at),
    },
    "label",
)

SECTIONS: Final[Mapping[str, Read[object]]] = {
    "name": values.text,
    "api": values.word(*APIS),
    "why": values.text,
    "schedule": SCHEDULE,
    "roles": named(ROLE),
    "rewards": named(TERM),
    "endings": named(ENDING),
    "seeds": section(Seeds, {"deterministic": values.truth}),
    "infos": named(INFO),
    "knobs": named(KNOB),
    "failure": named(values.failure),
    "waivers": named(values.waiver),
}
"""The sections of a contract in the order they are written, and how each is read."""


def read_sections(value: object, at: Place) -> dict[str, object]:
    """The declared sections of a contract, each as its frozen data.

    Raises:
        ContractError: a key is unknown, or a value isn't of its key's kind.
    """
    table = dict(at.table(value))
    for key in table:
        if key not in SECTIONS:
            raise unknown_key(at / key, SECTIONS)
    found: dict[str, object] = {}
    rewards = table.get("rewards")
    if isinstance(rewards, Mapping) and "after_end" in rewards:
        place = at / "rewards" / "after_end"
        found["after_end"] = values.word(*AFTER_END)(rewards["after_end"], place)
        table["rewards"] = {key: item for key, item in rewards.items() if key != "after_end"}
    return found | {key: SECTIONS[key](item, at / key) for key, item in table.items()}
