"""Results that an earlier call of an evaluation left in a folder, and if a call continues it."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.episodes.episode import object_of
from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.evaluation.inspection import Inspection, digest_of
from gamekeeper.evaluation.matchups import SELF, Match
from gamekeeper.evaluation.spec import Spec, plain_of
from gamekeeper.rollouts.executors.storage import Storage

PLAN: Final = "plan.json"
RESULT: Final = "evaluation.json"
RESULT_BYTES: Final = 1 << 28


def settle_plan(
    spec: Spec, inspections: Mapping[str, Inspection], matches: Sequence[Match], storage: Storage
) -> list[str]:
    """Notes what is played into a storage; says what has changed since it was noted last.

    Raises:
        RunError: something else lies there, or results that this call wouldn't have.
    """
    plan = {
        "name": spec.name,
        "settings": {"seed": spec.seed, "infos": list(spec.infos)},
        "environments": {
            name: {
                "digest": inspection.digest,
                "version": inspection.version,
                "contract": digest_of(inspection.contract),
            }
            for name, inspection in inspections.items()
        },
        "policies": {
            policy: {
                name: list(inspection.policies.get(policy, ()))
                for name, inspection in inspections.items()
            }
            for policy in spec.policies
        },
    }
    before: dict[str, Any] = {}
    if storage.exists(PLAN):
        before = _read_plan(storage)
        if before.get("name") != spec.name:
            raise _occupied(storage, f"the evaluation {before.get('name')!r}")
    elif names := storage.names():
        raise _occupied(storage, ", ".join(names[:3]))
    if before and storage.exists(RESULT):
        lost = list(_lost(document_in(storage), spec, matches))
        if lost:
            raise RunError(
                "the folder holds results of another evaluation, which would be lost",
                where=str(storage),
                expected="at least the episodes, environments and policies that are there",
                actual="; ".join(lost),
                fix="name another folder with --out (out=...), or delete this one to start anew",
            )
    storage.put(PLAN, json.dumps(plan, sort_keys=True, indent=1).encode())
    return list(_changes(before, plan)) if before else []


def document_in(storage: Storage) -> dict[str, Any]:
    """The results of an evaluation, as plain data.

    Raises:
        RunError: there are none.
        EvidenceError: what lies there is no JSON object.
    """
    text = storage.get(RESULT, most_bytes=RESULT_BYTES)
    try:
        return object_of(text.decode())
    except (ValueError, RecursionError) as error:
        raise EvidenceError(
            "this is no evaluation",
            where=str(storage),
            expected="a JSON object",
            actual=str(error)[:200],
            fix="name a folder that gamekeeper evaluate wrote",
        ) from error


def _lost(before: Mapping[str, Any], spec: Spec, matches: Sequence[Match]) -> Iterator[str]:
    """Results that lie there and that this call wouldn't have."""
    if before.get("seed") != spec.seed:
        yield f"seed {before.get('seed')} there, {spec.seed} asked for"
    most = spec.episodes if spec.stop is None else max(spec.episodes, spec.stop.most)
    if most < before.get("episodes", 0):
        yield f"{before['episodes']} episodes there, {most} asked for"
    for name, was in before.get("environments", {}).items():
        environment = spec.environments.get(name)
        if environment is None:
            yield f"environment {name}, now without it"
            continue
        for key in ("spec", "kwargs", "options"):
            value = getattr(environment, key)
            now = plain_of(dict(value) if key == "kwargs" else value)
            if key in was and was[key] != now:
                yield f"{key} of {name} {json.dumps(was[key])}, now {json.dumps(now)}"
    for name, was in before.get("policies", {}).items():
        policy = spec.policies.get(name)
        if policy is None:
            yield f"policy {name}, now without it"
            continue
        runs = [plain_of(dict(each)) for each in policy.runs]
        if runs[: len(was["choices"])] != was["choices"]:
            yield f"policy {name} as {_players(was['choices'])}, now {_players(runs)}"
    met = {
        (match.environment, frozenset((at, side.policy) for at, side in match.pairing.sides))
        for match in matches
    }
    for name, each in before.get("crossplay", {}).items():
        positioned = (
            frozenset(cell["roles"].items()) for cell in each["cells"] if cell["kind"] != SELF
        )
        if name in spec.environments and any((name, cell) not in met for cell in positioned):
            yield f"cross-play in {name}, now without all of its pairings"


def _players(runs: Sequence[Any]) -> str:
    """Policies by position, of one run or of several."""
    return json.dumps(runs[0] if len(runs) == 1 else runs)[:200]


def _read_plan(storage: Storage) -> dict[str, Any]:
    try:
        plan = json.loads(storage.get(PLAN))
    except ValueError:
        plan = None
    if not isinstance(plan, dict):
        raise _occupied(storage, f"{PLAN} of something else")
    return plan


def _occupied(storage: Storage, seen: str) -> RunError:
    return RunError(
        "something else lies where the evaluation is to go",
        where=str(storage),
        expected="nothing, or an earlier call of this evaluation",
        actual=seen,
        fix="name another folder with --out (out=...)",
    )


def _changes(before: Mapping[str, Any], plan: Mapping[str, Any]) -> Iterator[str]:
    """Stale parts, each with its reason."""
    for key, value in plan["settings"].items():
        was = before.get("settings", {}).get(key)
        if was != value:
            yield f"everything is stale: {key} was {was}, now it is {value}"
    why = {
        "digest": "its source or its arguments",
        "version": "its version",
        "contract": "its contract",
    }
    for name, now in plan["environments"].items():
        was = before.get("environments", {}).get(name)
        parts = [text for key, text in why.items() if was and was.get(key) != now[key]]
        if parts:
            yield f"environment {name} is stale: {' and '.join(parts)} changed"
    for name, by_environment in plan["policies"].items():
        was = before.get("policies", {}).get(name, {})
        for environment, digests in by_environment.items():
            then: Sequence[str] = was.get(environment, ())
            runs = [
                k for k, pair in enumerate(zip(then, digests, strict=False)) if len(set(pair)) > 1
            ]
            if runs:
                which = "" if len(digests) == 1 else f", run {', '.join(map(str, runs))}"
                yield f"policy {name} in {environment}{which} is stale: its file or source changed"
