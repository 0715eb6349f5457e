"""Checks of infos."""

from typing import Any

import numpy as np

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.space_facts import PickledInfo
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract, InfoField
from gamekeeper.episodes.canonical import type_name


@check("GK240", MEDIUM, "rollout", looks_at="an info of an agent")
def infos_are_dictionaries(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every agent's info is a dictionary, also in the step in which it ends; never None.

    Readers look into it with `info.get(...)` at every step, and crash in the rare one in which it
    is None, a list or a text.

    Bad:
        infos = {a: {"score": s} if a in self.agents else None for a in acting}

    Good:
        infos = {a: {"score": s} if a in self.agents else {} for a in acting}

    Fix: give every agent a dictionary for its info; an empty one where there is nothing to say
    """
    for episode in evidence["rollout"]:
        for turn in episode.turns:
            strange = turn.nonconforming
            for agent in turn.infos:
                seen = strange.get(agent, {}).get("info")
                where = episode.at(turn, agent, "infos")
                told = None if seen is None else f"a {seen['type']}: {seen.get('value')!r}"
                info = _info_of(evidence.api, agent)
                proof = f"info = {info}\nassert isinstance(info, dict), info"
                yield Case(where, seen is None, "a dictionary", told, proof)


def _info_of(api: str, agent: str) -> str:
    """The agent's info, as Python."""
    return (
        "env.last()[-1]"
        if api == "aec"
        else f"next(infos[a] for a in infos if str(a) == {agent!r})"
    )


@check("GK242", LOW, "spaces")
def infos_can_be_pickled(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Infos hold what can be pickled, and so sent from one process to another.

    Vector environments run copies in processes of their own and send infos through a pipe.

    Bad:
        infos[agent] = {"replay": lambda: self.history}

    Good:
        infos[agent] = {"replay": list(self.history)}

    Fix: put plain data and arrays into infos, not functions, generators or the environment
    """
    for fact in evidence.facts(PickledInfo):
        why = fact.value.unpicklable
        infos = "env.infos" if evidence.api == "aec" else "infos"
        lines = f"for info in {infos}.values():\n    pickle.dumps(info)"
        proof = Reproducer(lines, imports=("pickle",))
        yield Case(fact.where, why is None, "an info that can be pickled", why, proof)


def _none_declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    fields = contract.infos.values()
    is_declared = any(each.dtype is not None or each.shape is not None for each in fields)
    return None if is_declared else "the contract declares no field of the infos"


@check(
    "GK243",
    MEDIUM,
    "rollout",
    applies=_none_declared,
    looks_at="a field of the infos that the contract declares",
)
def infos_are_as_declared(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A field of the infos has the dtype and the shape that the contract declares for it.

    A table of the infos has the columns that the declaration says.

    Bad:
        position = { dtype = "int64", shape = [2] }          # infos[a] = {"position": (0.5, 1.0)}

    Good:
        position = { dtype = "float64", shape = [2] }

    Fix: give the field as infos.<field> declares it, or declare what is given
    """
    declared = {
        name: each
        for name, each in contract.infos.items()
        if each.dtype is not None or each.shape is not None
    }
    for episode in evidence["rollout"]:
        for turn in episode.turns:
            for agent, info in turn.infos.items():
                if not isinstance(info, dict):
                    continue
                for name, each in declared.items():
                    if name in info:
                        seen = fault_of(each, info[name])
                        where = episode.at(turn, agent, f"infos[{name!r}]")
                        expected = f"dtype {each.dtype}, shape {each.shape}"
                        proof = _info_declared_proof(evidence.api, agent, name, each)
                        yield Case(where, seen is None, expected, seen, proof)


def fault_of(declared: InfoField, value: Any) -> str | None:
    """Value in place of the declared one; a plain number has any dtype of its kind."""
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


def _info_declared_proof(api: str, agent: str, name: str, declared: InfoField) -> str:
    lines = [f"value = {_info_of(api, agent)}[{name!r}]"]
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
