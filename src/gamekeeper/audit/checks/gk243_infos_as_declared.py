"""GK243."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.canon import type_name
from gamekeeper.core.contract import Contract, InfoField
from gamekeeper.core.gathered import Gathered


def _none_declared(contract: Contract, evidence: Gathered) -> str | None:
    fields = contract.infos.values()
    is_declared = any(each.dtype is not None or each.shape is not None for each in fields)
    return None if is_declared else "the contract declares no field of the infos"


@check(
    "GK243",
    needs=("rollout",),
    severity=MEDIUM,
    mend="give the field as infos.<field> declares it, or declare what is given",
    applies=_none_declared,
)
def infos_are_as_declared(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A field of the infos has the dtype and the shape that the contract declares for it.

    Whoever makes a table of the infos makes its columns from the declaration.

    Bad:

        position = { dtype = "int64", shape = [2] }          # infos[a] = {"position": (0.5, 1.0)}

    Good:

        position = { dtype = "float64", shape = [2] }
    """
    declared = {
        name: each
        for name, each in contract.infos.items()
        if each.dtype is not None or each.shape is not None
    }
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            for agent, info in turn.infos.items():
                if not isinstance(info, dict):
                    continue
                for name, each in declared.items():
                    if name in info:
                        seen = fault_of(each, info[name])
                        yield Occasion(
                            trace.at(turn, agent, f"infos[{name!r}]"), seen is None,
                            f"dtype {each.dtype}, shape {each.shape}", seen,
                            proof=_proof(evidence.api, agent, name, each),
                        )  # fmt: skip


def fault_of(declared: InfoField, value: Any) -> str | None:
    """What is there in place of what is declared; a plain number has any dtype of its kind."""
    if declared.dtype == "json":
        return None
    if declared.dtype == "str":
        return None if isinstance(value, str) else f"a {type_name(value)}"
    try:
        array = np.asarray(value)
    except ValueError:
        return f"a {type_name(value)} that is no array"
    if declared.shape is not None and array.shape != declared.shape:
        return f"shape {array.shape}"
    if declared.dtype is None:
        return None
    wanted = np.dtype(declared.dtype)
    if isinstance(value, np.ndarray | np.generic):
        return None if array.dtype == wanted else f"dtype {array.dtype}"
    is_alike = array.dtype.kind == wanted.kind or (wanted.kind == "u" and array.dtype.kind == "i")
    return None if is_alike else f"a {type_name(value)} of {array.dtype}"


def _proof(api: str, agent: str, name: str, declared: InfoField) -> str:
    info = "env.last()[-1]"
    if api == "parallel":
        info = f"next(infos[a] for a in infos if str(a) == {agent!r})"
    lines = [f"value = {info}[{name!r}]"]
    if declared.shape is not None:
        lines.append(f"assert np.shape(value) == {tuple(declared.shape)!r}, value")
    if declared.dtype == "str":
        lines.append("assert isinstance(value, str), value")
    elif declared.dtype not in (None, "json"):
        lines.append(
            f"assert np.asarray(value).dtype.kind == {np.dtype(declared.dtype).kind!r}, value"
        )
        lines.append("if isinstance(value, np.ndarray | np.generic):")
        lines.append(f"    assert value.dtype == {declared.dtype!r}, value.dtype")
    return "\n".join(lines)
