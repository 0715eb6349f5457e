"""Parts as workers play them: each in a fresh environment, into a bundle of its own.

What a task returns is small; the evidence goes from the worker to storage.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from gamekeeper.core.evidence import Evidence
from gamekeeper.errors import BundleError, EnvError, GamekeeperError
from gamekeeper.game.opening.construct import foreign_traceback
from gamekeeper.record.bundle import load
from gamekeeper.record.files.manifest import MANIFEST
from gamekeeper.record.parts.plan import FOLDER, Plan, key_of
from gamekeeper.record.parts.receipt import Receipt, attempt_folder, receipt_of, schemas_of
from gamekeeper.record.recording import played
from gamekeeper.record.recover import recover
from gamekeeper.record.tasks import counter, error_fields, signs_of_life
from gamekeeper.run.executors.storage import Storage


def part_task(
    report: Callable[..., None], *, storage: str, plan: Mapping[str, Any], first: int, stop: int
) -> dict[str, Any]:
    """Plays the episodes from `first` to before `stop`, unless their receipt is there already.

    Returns:
        `error` (its fields, where nothing came of it that counts), and of what came of it
        `episodes`, `turns` and whether the last one `failed`.
    """
    place, key = Storage.at(storage), key_of(range(first, stop))
    found = receipt_of(place, key)
    if found is not None:  # an attempt that was thought dead, or whose answer got lost
        return {"error": None, **found.said()}
    try:
        receipt = _played(report, place, Plan.from_json(plan), range(first, stop))
        with signs_of_life(report):
            receipt.put(place)
    except GamekeeperError as error:
        return {"error": error_fields(error)}
    return {"error": None, **receipt.said()}


def remains_task(
    report: Callable[..., None],
    *,
    storage: str,
    first: int,
    stop: int,
    error: Mapping[str, str],
    stack: str | None,
) -> dict[str, Any]:
    """Seals what the attempts at a part left that all died, as far as its turns are whole.

    Of several the last one counts. Where attempts wrote to a disk of their worker's own, nothing is
    left of them.
    """
    place, key = Storage.at(storage), key_of(range(first, stop))
    found = receipt_of(place, key)
    if found is not None:
        return {"error": None, **found.said()}
    parent = place.path_of(FOLDER)
    tries = sorted(parent.glob(f"{key}.*/"), key=_changed_s) if parent is not None else []
    # The last line says what it was, as in a traceback of Python.
    told = "\n".join(filter(None, (stack, f"{error['what']}: {error['seen']}".removesuffix(": "))))
    with signs_of_life(report):
        for bundle in reversed(tries):
            try:
                evidence = recover(bundle, status="failed", error=told)
            except BundleError:  # it died before there was a manifest
                continue
            if evidence.episodes.num_rows:
                name = f"{FOLDER}/{bundle.name}"
                receipt = _receipt(key, name, bundle, evidence, first, error)
                receipt.put(place)
                return {"error": None, **receipt.said()}
    return {"error": None, "episodes": 0, "turns": 0, "failed": True}


def _played(report: Callable[..., None], storage: Storage, plan: Plan, episodes: range) -> Receipt:
    key = key_of(episodes)
    name = attempt_folder(key)
    failed: Mapping[str, str] | None = None
    with _folder(storage, name) as bundle:
        try:
            evidence = played(
                plan.spec, policies=dict(plan.policies) or "random", episodes=len(episodes),
                first=episodes.start, seed=plan.seed, out=bundle, level=plan.level,
                contract=plan.contract, options=plan.options, most_turns=plan.most_turns,
                frames=plan.frames, env_kwargs=plan.env_kwargs,
                after_turn=counter(report, len(episodes)),
                after_episode=lambda done: report(episode=done),
                while_sealing=lambda: signs_of_life(report), durable=False,
            )  # fmt: skip
        except EnvError as error:
            if error.__cause__ is not None:
                sys.stderr.write(f"{foreign_traceback(error.__cause__)}\n")
            failed = error_fields(error)
            if not (bundle / MANIFEST).exists():  # it failed before there was anything to keep
                raise
            evidence = load(bundle, check=False)
        with signs_of_life(report):
            receipt = _receipt(key, name, bundle, evidence, episodes.start, failed)
            if storage.folder is None:
                storage.put_folder(name, bundle)
            return receipt


def _receipt(
    key: str,
    name: str,
    bundle: Path,
    evidence: Evidence,
    first: int,
    error: Mapping[str, str] | None,
) -> Receipt:
    rows = evidence.episodes
    turns = pc.sum(rows["turns"]).as_py() or 0
    return Receipt(key, name, first, rows.num_rows, turns, error, schemas_of(bundle))


@contextmanager
def _folder(storage: Storage, name: str) -> Iterator[Path]:
    """Where an attempt writes: in storage itself where that is a folder, else on this disk."""
    place = storage.path_of(name)
    scratch = None if place is not None else Path(tempfile.mkdtemp(prefix="gamekeeper-part-"))
    folder = place if place is not None else Path(str(scratch)) / "bundle"
    try:
        yield folder
    finally:
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)


def _changed_s(folder: Path) -> float:
    """When a file of a folder was last changed."""
    return max((path.stat().st_mtime for path in folder.rglob("*")), default=0.0)
