"""What is to be played, part by part, each named by everything that settles what comes out."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gamekeeper.errors import BundleError
from gamekeeper.evaluate.digests import digest_of
from gamekeeper.evaluate.look import Look, crossing, opening_of
from gamekeeper.evaluate.matchups import Pairing, by_themselves, crossed, seats_of
from gamekeeper.evaluate.play import PARTS, PLAY
from gamekeeper.evaluate.spec import Spec
from gamekeeper.run.executors.storage import Storage
from gamekeeper.run.executors.task import Task

CHUNK: Final = 20
"""Episodes of a part: another number would give an environment that leaks other results."""
PLAN: Final = "plan.json"


@dataclass(frozen=True, slots=True)
class Match:
    """A line-up in an environment.

    Attributes:
        environment: its name.
        pairing: who sits where.
        seats: of cross-play there; empty where there is none.
        arguments: of the playing task, but for the episodes.
        digest: of everything that settles what an episode comes to.
    """

    environment: str
    pairing: Pairing
    seats: tuple[str, ...]
    arguments: Mapping[str, Any]
    digest: str

    def key(self, first: int, last: int) -> str:
        """The name of a part."""
        return f"{self.digest}.{first}-{last}"

    def task(self, first: int, last: int, place: str) -> Task:
        """The task that plays a part into storage."""
        key = self.key(first, last)
        what = {**self.arguments, "first": first, "last": last}
        return Task(key, PLAY, {"place": place, "key": key, **what})


def matches_of(spec: Spec, looks: Mapping[str, Look], *, is_here: bool) -> list[Match]:
    """Every line-up of every environment, in the order of the specification.

    Args:
        spec: of the evaluation.
        looks: what environments and policies are.
        is_here: it is played in this process, so that objects needn't be named.
    Raises:
        EvidenceError: there are too many, or a policy is an object that can't leave this process.
        PolicyError: a policy says nothing for a seat.
    """
    found = []
    for name in spec.environments:
        look = looks[name]
        seats: tuple[str, ...] = ()
        pairings = by_themselves(spec, name)
        if spec.crossplay.enabled:
            seats = seats_of(spec, name, look)
            pairings += crossed(spec, name, look, seats)
        found += [_match(spec, name, look, each, seats, is_here=is_here) for each in pairings]
    return found


def _match(
    spec: Spec, name: str, look: Look, pairing: Pairing, seats: tuple[str, ...], *, is_here: bool
) -> Match:
    environment = spec.environments[name]
    opening: Any = opening_of(environment, spec)
    options: Any = environment.options
    if not is_here:
        opening, options = crossing(opening, options)
    sides = {seat: [side.policy, side.run] for seat, side in pairing.sides}
    settled: dict[str, Any] = {
        "label": {"environment": name, "pairing": pairing.name}, "sides": sides,
        "seed": spec.seed, "most_turns": environment.most_turns,
        "success": dict(environment.success), "infos": list(spec.infos),
    }  # fmt: skip
    playing = {seat: look.policies[side.policy][side.run] for seat, side in pairing.sides}
    digest = digest_of([settled, look.digest, look.version, look.contract, playing])
    arguments = {
        **settled, "opening": opening, "choices": dict(pairing.choices), "options": options,
    }  # fmt: skip
    return Match(name, pairing, seats, arguments, digest[:24])


def chunks(first: int, last: int) -> Iterator[tuple[int, int]]:
    """The bounds of the parts that episodes `first` to `last - 1` fall into."""
    for start in range(first, last, CHUNK):
        yield start, min(start + CHUNK, last)


def played_keys(storage: Storage) -> set[str]:
    """The parts that have a receipt."""
    names = storage.names(PARTS) if storage.exists(PARTS) else []
    return {name.removesuffix(".json") for name in names if name.endswith(".json")}


def settle_plan(spec: Spec, looks: Mapping[str, Look], storage: Storage) -> list[str]:
    """Notes what is played into a storage; says what has changed since it was noted last.

    Raises:
        BundleError: something else lies there.
    """
    plan = {
        "name": spec.name,
        "settings": {"seed": spec.seed, "infos": list(spec.infos)},
        "environments": {
            name: {"digest": look.digest, "version": look.version,
                   "contract": digest_of(look.contract)}
            for name, look in looks.items()
        },
        "policies": {
            policy: {name: list(look.policies.get(policy, ())) for name, look in looks.items()}
            for policy in spec.policies
        },
    }  # fmt: skip
    before: dict[str, Any] = {}
    if storage.exists(PLAN):
        before = _read_plan(storage)
        if before.get("name") != spec.name:
            raise _occupied(storage, f"the evaluation {before.get('name')!r}")
    elif names := storage.names():
        raise _occupied(storage, ", ".join(names[:3]))
    storage.put(PLAN, json.dumps(plan, sort_keys=True, indent=1).encode())
    return list(_changes(before, plan)) if before else []


def _read_plan(storage: Storage) -> dict[str, Any]:
    try:
        plan = json.loads(storage.get(PLAN))
    except ValueError:
        plan = None
    if not isinstance(plan, dict):
        raise _occupied(storage, f"{PLAN} of something else")
    return plan


def _occupied(storage: Storage, seen: str) -> BundleError:
    return BundleError(
        "something else lies where the evaluation is to go", where=str(storage),
        expected="nothing, or an earlier call of this evaluation", seen=seen,
        mend="name another folder with --out (out=...)",
    )  # fmt: skip


def _changes(before: Mapping[str, Any], plan: Mapping[str, Any]) -> Iterator[str]:
    """What is stale, and why."""
    for key, value in plan["settings"].items():
        was = before.get("settings", {}).get(key)
        if was != value:
            yield f"everything is stale: {key} was {was}, now it is {value}"
    why = {"digest": "its source or its arguments", "version": "its version",
           "contract": "its contract"}  # fmt: skip
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
