"""Reading a contract's sections from plain data: every key known, every section its class."""

import re
from collections.abc import Mapping
from typing import Final

from gamekeeper.contract.failure import Failure
from gamekeeper.contract.scene import SCENE
from gamekeeper.contract.sections import (
    AFTER_END,
    APIS,
    CONFLICTS,
    ENDING_KINDS,
    ILLEGAL,
    KINDS,
    KNOB_OF,
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
from gamekeeper.contract.validation import (
    Read,
    SourcePath,
    can_be_told,
    different,
    listed,
    named,
    names,
    nearest,
    section,
    text,
    truth,
    unknown_key,
    whole,
    word,
)
from gamekeeper.errors import ContractError

CHECK_ID: Final = re.compile(r"[A-Z]{2,8}\d{3,4}")
MASK: Final = re.compile(r"(infos|observation)(\.[^.\s]+)+")
MAX_DEPTH: Final = 16
"""Levels of lists and tables in a noop or an ideal value."""


def mask(value: object, at: SourcePath) -> str:
    """Reads where a mask stands."""
    if isinstance(value, str) and (value == NONE or MASK.fullmatch(value)):
        return value
    usual = ("infos.action_mask", "observation.action_mask", NONE)
    near = nearest(value, usual)
    raise at.error(
        f"'{at.text}' doesn't say where the mask stands",
        expected='"infos.KEY", "observation.KEY", or "none"',
        actual=value,
        fix=f'write "{near or usual[0]}"',
    )


def anything(value: object, at: SourcePath) -> Plain:
    """Reads any value that TOML and JSON both hold exactly."""
    try:
        _bounded(value, MAX_DEPTH)
        return frozen(value)
    except TypeError as error:
        raise at.error(
            f"'{at.text}' is not a plain value",
            expected="text, a finite number of 64 bits, true or false, or a list or table of them",
            actual=value,
            fix=f"replace {error}",
        ) from None


def _bounded(value: object, depth: int) -> None:
    if depth < 0:
        raise TypeError("what is nested so deeply")
    items = value.values() if isinstance(value, Mapping) else value
    if isinstance(value, Mapping | list | tuple):
        for item in items:  # type: ignore[attr-defined]
            _bounded(item, depth - 1)


def failure(value: object, at: SourcePath) -> Failure:
    """Reads a condition."""
    written = text(value, at)
    try:
        return Failure(written)
    except ContractError as error:
        raise at.error(error.what, expected=error.expected, actual=written, fix=error.fix) from None


def waiver(value: object, at: SourcePath) -> str:
    """Reads the reason of a waiver, whose key is the id of a check."""
    check = str(at.path[-1])
    if not CHECK_ID.fullmatch(check):
        upper = check.upper().replace("-", "").replace("_", "")
        right = CHECK_ID.fullmatch(upper)
        raise at.error(
            f"{check!r} is not the id of a check",
            expected="capital letters and a number of three or four digits, as GK402",
            actual=check,
            fix=f"write {upper}" if right else "take the id from the audit's report",
        )
    if not isinstance(value, str) or not value.strip():
        raise at.error(
            f"{check} is waived without a reason",
            expected="the reason as text",
            actual=value,
            fix=f'write why it is so on purpose: {check} = "…"',
        )
    return text(value, at)


DTYPES: Final = (
    "bool",
    *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)),
    *("float16", "float32", "float64", "str", "json"),
)

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
TERM: Final = section(RewardTerm, {"kind": word(*KINDS), "earner": names, "payee": names})
ENDING: Final = section(Ending, {"kind": word(*ENDING_KINDS), "owner": text})
INFO: Final = section(
    InfoField, {"dtype": word(*DTYPES), "shape": listed(whole(0)), "volatile": truth}
)
KNOB: Final = section(
    Knob,
    {
        "label": text,
        "ideal": anything,
        "of": word(*KNOB_OF),
        "worst": anything,
        "contains": lambda value, at: different(listed(text)(value, at), at),
    },
    "label",
)

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
    "scene": SCENE,
    "failure": named(failure),
    "waivers": named(waiver),
}
"""The sections of a contract in the order they are written, and how each is read."""


def read_sections(value: object, at: SourcePath) -> dict[str, object]:
    """The declared sections of a contract, each as its frozen data.

    Args:
        value: plain data.
        at: collects the mistakes; a key that has one is left out.
    Raises:
        ContractError: the data isn't a table; or, where `at` collects nothing, a key is unknown,
            or a value isn't of its key's kind.
    """
    table = dict(at.table(value))
    for key in table:
        if key not in SECTIONS:
            at.report(unknown_key(at / key, SECTIONS))
    found: dict[str, object] = {}
    rewards = table.get("rewards")
    if isinstance(rewards, Mapping) and "after_end" in rewards:
        place = at / "rewards" / "after_end"
        with at.collecting():
            found["after_end"] = word(*AFTER_END)(rewards["after_end"], place)
        table["rewards"] = {key: item for key, item in rewards.items() if key != "after_end"}
    for key, item in table.items():
        if key in SECTIONS:
            with at.collecting():
                found[key] = SECTIONS[key](item, at / key)
    return found


def with_placeholders(sections: dict[str, object], data: object) -> dict[str, object]:
    """The sections with an empty role or knob for each name whose declaration couldn't be read.

    So that a name which stands somewhere isn't called undeclared, beside the mistake that is there.
    """
    raw = data if isinstance(data, Mapping) else {}
    schedule = raw.get("schedule")
    stages = schedule.get("stages") if isinstance(schedule, Mapping) else None
    names = {
        "roles": [*_texts(raw.get("roles")), *_texts(stages)],
        "knobs": _texts(raw.get("knobs")),
    }
    blanks = {"roles": Role(), "knobs": Knob(label="unknown")}
    filled = dict(sections)
    for key, blank in blanks.items():
        read = sections.get(key)
        rows = dict.fromkeys(names[key], blank) | dict(read if isinstance(read, Mapping) else {})
        if rows:
            filled[key] = rows
    if stages is not None and getattr(sections.get("schedule"), "stages", None) is None:
        # Stages that can't be read may declare any role, so no other name can be called unknown.
        for key in ("rewards", "endings", "failure"):
            filled.pop(key, None)
    return filled


def _texts(value: object) -> list[str]:
    """The keys of a table that can be names; the texts in a list, and in the lists in it."""
    if isinstance(value, str):
        return [value] if can_be_told(value) else []
    if isinstance(value, Mapping):
        return [key for key in value if isinstance(key, str) and can_be_told(key)]
    items = value if isinstance(value, list | tuple) else ()
    inner = (each if isinstance(each, list | tuple) else (each,) for each in items)
    return [
        text for each in inner for item in each if isinstance(item, str) for text in _texts(item)
    ]
