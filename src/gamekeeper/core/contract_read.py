"""Reading a contract's sections from plain data: every key known, every value of its kind."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final, TypeVar

from gamekeeper.core.contract_parts import (
    AFTER_END,
    APIS,
    CONFLICTS,
    ENDING_KINDS,
    ILLEGAL,
    KINDS,
    NONE,
    OBSERVE,
    ORDERS,
    Ending,
    InfoField,
    Knob,
    Plain,
    RewardTerm,
    Role,
    Schedule,
    Seeds,
    frozen,
)
from gamekeeper.core.failure import Failure
from gamekeeper.core.places import Place, nearest, path_text, shown
from gamekeeper.core.table import Table
from gamekeeper.errors import ContractError

T = TypeVar("T")
Read = Callable[[object, Place], T]

CHECK_ID: Final = re.compile(r"[A-Z]{2,8}\d{3,4}")
MASK: Final = re.compile(r"(infos|observation)(\.[^.\s]+)+")
DTYPES: Final = (
    "bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64",
    "float16", "float32", "float64", "str", "json",
)  # fmt: skip
MAX_DEPTH: Final = 16
"""Levels of lists and tables in a noop or an ideal value."""


def text(value: object, at: Place) -> str:
    """The value as text that any file can hold.

    Raises:
        ContractError: it is something else, empty, or holds half of a surrogate pair.
    """
    if not isinstance(value, str):
        raise at.error(
            f"'{at.text}' is not text",
            expected="text in quotes",
            seen=value,
            mend="put it in quotes",
        )
    if not value.strip() or any("\ud800" <= char <= "\udfff" for char in value):
        raise at.error(
            f"'{at.text}' says nothing that can be read",
            expected="text of at least one letter",
            seen=value,
            mend="say it, or leave the key out",
        )
    return str(value)


def truth(value: object, at: Place) -> bool:
    """The value as true or false."""
    if isinstance(value, bool):
        return value
    mend = "write it without quotes" if value in ("true", "false") else "write true or false"
    raise at.error(
        f"'{at.text}' is not a truth value", expected="true or false", seen=value, mend=mend
    )


def whole(least: int) -> Read[int]:
    """Reads whole numbers from `least` on that fit into 64 bits."""

    def read(value: object, at: Place) -> int:
        if isinstance(value, int) and not isinstance(value, bool) and least <= value < 2**63:
            return int(value)
        raise at.error(
            f"'{at.text}' is not a whole number from {least} on",
            expected=f"a whole number, at least {least}",
            seen=value,
            mend=f"write a whole number from {least} on, or leave the key out",
        )

    return read


def word(*allowed: str) -> Read[str]:
    """Reads one of the allowed words."""

    def read(value: object, at: Place) -> str:
        if isinstance(value, str) and value in allowed:
            return value
        raise at.unknown(f"'{at.text}' can't be {shown(value)}", value, allowed, noun="word")

    return read


def listed(item: Read[T], *, least: int = 0) -> Read[tuple[T, ...]]:
    """Reads lists with at least `least` items."""

    def read(value: object, at: Place) -> tuple[T, ...]:
        if not isinstance(value, list | tuple) or len(value) < least:
            raise at.error(
                f"'{at.text}' is not a list" + (f" of {least} or more" if least else ""),
                expected="a list in square brackets" + (f", {least} or more" if least else ""),
                seen=value,
                mend="put the items into [ ]" if not isinstance(value, list | tuple) else "fill it",
            )
        return tuple(item(each, at / number) for number, each in enumerate(value))

    return read


def names(value: object, at: Place) -> tuple[str, ...]:
    """Reads one name, or a list of different names."""
    if isinstance(value, str):
        return (text(value, at),)
    return different(listed(text, least=1)(value, at), at)


def different(items: tuple[str, ...], at: Place) -> tuple[str, ...]:
    """The items, none of which stands twice.

    Raises:
        ContractError: one stands twice.
    """
    for number, item in enumerate(items):
        if item in items[:number]:
            raise (at / number).error(
                f"{item!r} stands twice in '{at.text}'",
                expected="each name once",
                seen=list(items),
                mend="leave the second out",
            )
    return items


def mask(value: object, at: Place) -> str:
    """Reads where a mask stands."""
    if isinstance(value, str) and (value == NONE or MASK.fullmatch(value)):
        return value
    usual = ("infos.action_mask", "observation.action_mask", NONE)
    near = nearest(value, usual)
    raise at.error(
        f"'{at.text}' doesn't say where the mask stands",
        expected='"infos.KEY", "observation.KEY", or "none"',
        seen=value,
        mend=f'write "{near or usual[0]}"',
    )


def anything(value: object, at: Place) -> Plain:
    """Reads any value that TOML and JSON both hold exactly."""
    try:
        _bounded(value, MAX_DEPTH)
        return frozen(value)
    except TypeError as error:
        raise at.error(
            f"'{at.text}' is not a plain value",
            expected="text, a finite number of 64 bits, true or false, or a list or table of them",
            seen=value,
            mend=f"write {error} as a plain value",
        ) from None


def _bounded(value: object, depth: int) -> None:
    if depth < 0:
        raise TypeError("what is nested so deeply")
    items = value.values() if isinstance(value, Mapping) else value
    if isinstance(value, Mapping | list | tuple):
        for item in items:  # type: ignore[attr-defined]
            _bounded(item, depth - 1)


def failure(value: object, at: Place) -> Failure:
    """Reads a condition."""
    written = text(value, at)
    try:
        return Failure(written)
    except ContractError as error:
        raise at.error(error.what, expected=error.expected, seen=written, mend=error.mend) from None


def waiver(value: object, at: Place) -> str:
    """Reads the reason of a waiver, whose key is the id of a check."""
    check = str(at.path[-1])
    if not CHECK_ID.fullmatch(check):
        upper = check.upper().replace("-", "").replace("_", "")
        right = CHECK_ID.fullmatch(upper)
        raise at.error(
            f"{check!r} is not the id of a check",
            expected="capital letters and a number of three or four digits, as GK402",
            seen=check,
            mend=f"write {upper}" if right else "take the id from the audit's report",
        )
    if not isinstance(value, str) or not value.strip():
        raise at.error(
            f"{check} is waived without a reason",
            expected="the reason as text",
            seen=value,
            mend=f'write why it is so on purpose: {check} = "…"',
        )
    return text(value, at)


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
        return Table({text(key, at / key): item(each, at / key) for key, each in rows})

    return read


STAGE: Final = listed(text, least=1)
SCHEDULE: Final = section(
    Schedule,
    {
        "stages": listed(lambda value, at: different(STAGE(value, at), at), least=1),
        "order": word(*ORDERS),
        "observe": word(*OBSERVE),
        "conflicts": word(*CONFLICTS),
        "horizon": whole(1),
    },
)
ROLE: Final = section(
    Role,
    {
        "agents": names,
        "symmetric": truth,
        "may_join": truth,
        "may_leave": truth,
        "noop": anything,
        "mask": mask,
        "messages": lambda value, at: different(listed(text)(value, at), at),
        "illegal": word(*ILLEGAL),
    },
)
TERM: Final = section(RewardTerm, {"kind": word(*KINDS), "earner": names, "payee": names}, "kind")
ENDING: Final = section(Ending, {"kind": word(*ENDING_KINDS), "owner": text}, "kind")
INFO: Final = section(
    InfoField, {"dtype": word(*DTYPES), "shape": listed(whole(0)), "volatile": truth}
)
KNOB: Final = section(Knob, {"label": text, "ideal": anything}, "label")

SECTIONS: Final[Mapping[str, Read[object]]] = {
    "name": text,
    "api": word(*APIS),
    "why": text,
    "schedule": SCHEDULE,
    "roles": named(ROLE),
    "rewards": named(TERM),
    "endings": named(ENDING),
    "seeds": section(Seeds, {"deterministic": truth}),
    "infos": named(INFO),
    "knobs": named(KNOB),
    "failure": named(failure),
    "waivers": named(waiver),
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
        found["after_end"] = word(*AFTER_END)(rewards["after_end"], place)
        table["rewards"] = {key: item for key, item in rewards.items() if key != "after_end"}
    return found | {key: SECTIONS[key](item, at / key) for key, item in table.items()}
