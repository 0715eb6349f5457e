"""`gk.rollout(..., workers=N)`: the same evidence, played by processes side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from gamekeeper.core.evidence import Evidence
from gamekeeper.errors import EvidenceError
from gamekeeper.game.policy import EVERYONE
from gamekeeper.record.bundle import load
from gamekeeper.record.parts.apart import record_apart
from gamekeeper.record.parts.plan import Plan, parts_folder
from gamekeeper.run.executors.local import LocalExecutor
from gamekeeper.run.executors.storage import Storage
from gamekeeper.run.executors.task import Limits


def rollout_apart(
    spec: object,
    out: str | PathLike[str] | None,
    *,
    workers: int,
    policies: object,
    contract: object,
    env_kwargs: Mapping[str, Any] | None,
    first: int,
    after_episode: Callable[[int], None] | None,
    **settings: Any,
) -> Evidence:
    """Plays episodes by `workers` processes into the bundle `out`; see `rollout`.

    Raises:
        EvidenceError: what is given can't go to another process.
        EnvError: the environment failed; what one process would have kept is sealed as *failed*.
    """
    if out is None or first:
        raise EvidenceError(
            "workers record a whole run into a folder",
            where="out" if out is None else "first",
            expected="a folder, and episodes from 0 on",
            seen="None" if out is None else str(first),
            mend="name a folder: out='runs/mine'; a range of episodes is played without workers",
        )
    whole: dict[str, Any] = (
        dict(policies) if isinstance(policies, Mapping) else {EVERYONE: policies}
    )
    for where, given in [
        ("spec", spec),
        *((f"policies[{name!r}]", p) for name, p in whole.items()),
    ]:
        if not isinstance(given, str):
            raise _an_object(where, given, "a name that another process can open: module:callable")
    if not (contract is None or isinstance(contract, str | PathLike)):
        raise _an_object("contract", contract, "the path of its file")

    def take(fields: dict[str, Any]) -> None:
        if after_episode is not None and "episode" in fields:
            after_episode(fields["episode"])

    plan = Plan(
        spec=str(spec), env_kwargs=dict(env_kwargs or {}), policies=whole,
        contract=None if contract is None else fspath(contract), **settings,
    )  # fmt: skip
    folder = Path(out)
    with LocalExecutor(workers) as executor:
        played = record_apart(
            plan, folder, executor=executor, storage=Storage.at(parts_folder(folder)),
            limits=Limits(silence_s=None),  # nor would one process give up
            on_message=take,
        )  # fmt: skip
    if played.error is not None:
        raise played.error
    return load(folder)


def _an_object(where: str, seen: object, expected: str) -> EvidenceError:
    return EvidenceError(
        "an object of this process can't go to workers",
        where=where,
        expected=expected,
        seen=repr(seen)[:200],
        mend="name it, or play in this process: leave workers out",
    )
