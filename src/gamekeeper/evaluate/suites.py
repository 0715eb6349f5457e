"""Suites: specifications with an id that others cite. Built-in ones, and those of packages."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from gamekeeper import plugins
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.evaluate.digests import digest_of
from gamekeeper.evaluate.look import Look
from gamekeeper.evaluate.reading import read_file
from gamekeeper.evaluate.spec import Spec

GROUP: Final = "gamekeeper.suites"
"""Entry points whose objects are paths of TOML files."""
FOLDER: Final = "suites"
PINS: Final = ("digest", "digests", "version")


def suites() -> dict[str, Path]:
    """The files of the suites that can be named, by their names."""
    here = Path(str(importlib.import_module(__package__ or "").__file__)).parent / FOLDER
    found = {path.stem: path for path in sorted(here.glob("*.toml"))}
    for name, place in plugins.load(GROUP).found.items():
        if isinstance(place, str | Path) and name not in found:
            found[name] = Path(place)
    return found


def suite_named(name: str) -> Spec | None:
    """The suite of this name or id; None where there is none."""
    known = suites()
    if name in known:
        return read_file(known[name])
    specs = [read_file(path) for path in known.values()]
    return next((spec for spec in specs if spec.suite and spec.suite[0] == name), None)


def fingerprint_of(spec: Spec, looks: Mapping[str, Look]) -> str:
    """What makes a suite what it is: its specification, its environments and its policies.

    Pins don't count: a suite is the same before and after it was pinned. Versions do.
    """
    plain = spec.to_json()
    for row in plain["environments"].values():
        row.pop("digest", None)
    for row in plain["policies"].values():
        row.pop("digests", None)
    found = {name: [look.digest, look.policies] for name, look in looks.items()}
    return digest_of([plain, found])


def check_pins(spec: Spec, looks: Mapping[str, Look]) -> list[str]:
    """What is pinned and isn't what is installed here, one text each."""
    found = []
    for name, environment in spec.environments.items():
        look = looks[name]
        for what, pinned, now in (
            ("digest", environment.digest, look.digest),
            ("version", environment.version, look.version),
        ):
            if pinned is not None and pinned != now:
                found.append(f"environment {name}: {what} {pinned} is pinned, here it is {now}")
    for name, policy in spec.policies.items():
        here = sorted({digest for look in looks.values() for digest in look.policies.get(name, ())})
        missing = [digest for digest in policy.digests if digest not in here]
        strange = [digest for digest in here if policy.digests and digest not in policy.digests]
        if missing or strange:
            found.append(
                f"policy {name}: {', '.join(missing or policy.digests)} pinned, "
                f"here {', '.join(strange or here)}"
            )
    return found


def refuse_copies(spec: Spec, looks: Mapping[str, Look]) -> None:
    """Refuses a method of which one training run stands there under two names.

    Raises:
        EvidenceError: two runs are the same to the last byte.
    """
    for name, look in looks.items():
        for policy, digests in look.policies.items():
            if spec.policies[policy].is_method and len(set(digests)) < len(digests):
                first = next(k for k, digest in enumerate(digests) if digest in digests[:k])
                raise EvidenceError(
                    "two training runs of a method are one and the same",
                    where=f"policies.{policy}, {name}", expected="different runs",
                    seen=f"runs {digests.index(digests[first])} and {first}: {digests[first]}",
                    mend="leave one out: counted twice, it makes intervals too narrow",
                )  # fmt: skip


def refuse_unpinned(spec: Spec, texts: list[str]) -> None:
    """Refuses what isn't what was pinned.

    Raises:
        SpecError: always, where there is a text.
    """
    if texts:
        raise SpecError(
            "what is installed isn't what the suite pins", where=spec.suite[0] if spec.suite else
            spec.name, expected="the pinned digests", seen="; ".join(texts),
            mend="install what it was pinned with, or say --unpinned: the document then says so",
        )  # fmt: skip


def pinned(data: Mapping[str, Any], looks: Mapping[str, Look]) -> dict[str, Any]:
    """A specification's plain data with the digests of what is installed here."""
    environments = {
        name: {
            **({"spec": row} if isinstance(row, str) else row),
            "digest": looks[name].digest,
            **({} if looks[name].version is None else {"version": looks[name].version}),
        }
        for name, row in data["environments"].items()
    }
    policies = {}
    for name, row in data["policies"].items():
        known = ("policy", "runs", "version", "files", "digests", "environments")
        is_table = isinstance(row, Mapping) and any(key in row for key in known)
        inner = row if is_table else {"runs" if isinstance(row, list) else "policy": row}
        digests = dict.fromkeys(d for look in looks.values() for d in look.policies.get(name, ()))
        policies[name] = {**inner, "digests": list(digests)}
    return {**data, "environments": environments, "policies": policies}
