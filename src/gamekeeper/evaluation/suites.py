"""Suites: specifications with an id that others cite. Built-in ones, and those of packages."""

import importlib
import re
from collections.abc import Mapping
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from shlex import quote
from typing import Any, Final

from gamekeeper import plugins
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.evaluation.inspection import Inspection, digest_of
from gamekeeper.evaluation.spec import EVERYONE, Spec
from gamekeeper.evaluation.spec_reader import POLICY_KEYS, read_file, read_spec
from gamekeeper.interface.distributions import FACTORY_NAMES

GROUP: Final = "gamekeeper.suites"
"""Entry points whose objects are paths of TOML files."""
FOLDER: Final = "suites"


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


def fingerprint_of(spec: Spec, inspections: Mapping[str, Inspection]) -> str:
    """Identity of a suite: its specification, its environments and its policies.

    Pins don't count: a suite is the same before and after it was pinned. Versions do.
    """
    plain = spec.to_json()
    for row in plain["environments"].values():
        row.pop("digest", None)
    for row in plain["policies"].values():
        row.pop("digests", None)
    found = {
        name: [inspection.digest, inspection.policies] for name, inspection in inspections.items()
    }
    return digest_of([plain, found])


def check_pins(spec: Spec, inspections: Mapping[str, Inspection]) -> list[str]:
    """Differences between the pinned digests and those installed here, one text each."""
    found = []
    for name, environment in spec.environments.items():
        inspection = inspections[name]
        for what, pinned, now in (
            ("digest", environment.digest, inspection.digest),
            ("version", environment.version, inspection.version),
        ):
            if pinned is not None and pinned != now:
                found.append(f"environment {name}: {what} {pinned} is pinned, here it is {now}")
    for name, policy in spec.policies.items():
        here = sorted(
            {
                digest
                for inspection in inspections.values()
                for digest in inspection.policies.get(name, ())
            }
        )
        missing = [digest for digest in policy.digests if digest not in here]
        strange = [digest for digest in here if policy.digests and digest not in policy.digests]
        if missing or strange:
            found.append(
                f"policy {name}: {', '.join(missing or policy.digests)} pinned, "
                f"here {', '.join(strange or here)}"
            )
    return found


def refuse_copies(spec: Spec, inspections: Mapping[str, Inspection]) -> None:
    """Refuses a method of which one training run stands there under two names.

    Raises:
        EvidenceError: two runs are the same to the last byte.
    """
    for name, inspection in inspections.items():
        for policy, digests in inspection.policies.items():
            if spec.policies[policy].is_method and len(set(digests)) < len(digests):
                first = next(k for k, digest in enumerate(digests) if digest in digests[:k])
                raise EvidenceError(
                    "two training runs of a method are one and the same",
                    where=f"policies.{policy}, {name}",
                    expected="different runs",
                    actual=f"runs {digests.index(digests[first])} and {first}: {digests[first]}",
                    fix="leave one out: counted twice, it makes intervals too narrow",
                )


def refuse_role_names(spec: Spec, inspections: Mapping[str, Inspection]) -> None:
    """Refuses policies that are called as a role or an agent: they were meant for its position.

    Raises:
        SpecError: the name of a policy is one of an environment's roles or agents.
    """
    for name, inspection in inspections.items():
        for policy in spec.policies:
            if policy in inspection.role_names or policy in inspection.roles:
                raise SpecError(
                    "a policy has the name of a role or an agent",
                    where=f"policies.{policy}",
                    expected=f"a name that {name} gives to nobody",
                    actual=policy,
                    fix="policies by role are one policy: "
                    f"policies = {{'mine': {{'{policy}': ...}}}}; else call it something else",
                )


def refuse_unpinned(spec: Spec, texts: list[str]) -> None:
    """Refuses what isn't what was pinned.

    Raises:
        SpecError: always, where there is a text.
    """
    if texts:
        raise SpecError(
            "what is installed isn't what the suite pins",
            where=spec.suite[0] if spec.suite else spec.name,
            expected="the pinned digests",
            actual="; ".join(texts),
            fix="install what it was pinned with, or say --unpinned: the document then says so",
        )


def pinned(data: Mapping[str, Any], inspections: Mapping[str, Inspection]) -> dict[str, Any]:
    """A specification's plain data with the digests of what is installed here."""
    environments = {
        name: {
            **({"spec": row} if isinstance(row, str) else row),
            "digest": inspections[name].digest,
            **({} if inspections[name].version is None else {"version": inspections[name].version}),
        }
        for name, row in data["environments"].items()
    }
    policies = {}
    for name, row in data["policies"].items():
        is_table = isinstance(row, Mapping) and any(key in row for key in POLICY_KEYS)
        inner = row if is_table else {"runs" if isinstance(row, list) else "policy": row}
        digests = dict.fromkeys(
            d for inspection in inspections.values() for d in inspection.policies.get(name, ())
        )
        policies[name] = {**inner, "digests": list(digests)}
    return {**data, "environments": environments, "policies": policies}


def spec_of(
    given: object,
    *,
    policies: Mapping[str, Any] | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    crossplay: bool | Mapping[str, Any] | None = None,
    record: str | None = None,
    env_kwargs: Mapping[str, Any] | None = None,
    contract: Any = None,
) -> Spec:
    """The specification that is meant, with what is said beside it in place of its own.

    Args:
        given: a TOML file, a suite's name or id, plain data, a `Spec`; else what opens an
            environment, and then `policies` are asked for.
        policies: by name, as in a specification.
        episodes, seed, crossplay, record: in place of its own.
        env_kwargs, contract: of an environment.
    Raises:
        SpecError: it can't be read, or nothing can be played.
    """
    found = _read(given)
    if found is None:
        if not policies:
            raise SpecError(
                "no policy is named to be evaluated",
                where="policies",
                expected="policies by name",
                actual="none",
                fix="policies={'reference': 'reference', 'random': 'random'}; on a command line "
                "--policy reference --policy random",
            )
        row = {"spec": given, "kwargs": dict(env_kwargs or {})}
        row |= {} if contract is None else {"contract": contract}
        name = name_of(given)
        data = {"name": name, "environments": {name: row}, "policies": policies}
        found = read_spec(data, source="arguments")
    else:
        if env_kwargs or contract is not None:
            raise SpecError(
                "a specification says what its environments are given",
                where="env_kwargs",
                expected="none",
                actual="arguments",
                fix="write them under [environments.NAME]",
            )
        if policies:
            dummy = {"environments": dict.fromkeys(found.environments, "-")}
            found = replace(found, policies=read_spec({**dummy, "policies": policies}).policies)
    names = {
        part: dict.fromkeys(getattr(found, part), "-") for part in ("environments", "policies")
    }
    parts = _known(crossplay=crossplay, record=record)
    seeds = _known(run=seed, episodes=episodes)
    read = read_spec({**names, **parts, "seeds": seeds}, source="arguments")
    asked = (*parts, *_known(seed=seed, episodes=episodes))
    return replace(found, **{key: getattr(read, key) for key in asked})


def _known(**values: Any) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _read(given: object) -> Spec | None:
    """The specification, where it is one."""
    if isinstance(given, Spec):
        return given
    if isinstance(given, Mapping):
        return read_spec(given, source="spec", folder=Path())
    if isinstance(given, str | PathLike):
        text = fspath(given)
        if isinstance(text, str) and text.endswith(".toml"):
            return read_file(Path(text))
        return suite_named(str(text))
    return None


def name_of(given: object) -> str:
    """An environment's name in what opens it: `mpe2.simple_spread_v3:parallel_env` has its own."""
    if not isinstance(given, str):
        metadata = getattr(given, "metadata", None)
        named = metadata.get("name") if isinstance(metadata, dict) else None
        own = str(getattr(given, "__name__", type(given).__name__))
        if own in FACTORY_NAMES:  # its module says more
            own = str(getattr(given, "__module__", own)).rpartition(".")[2]
        return str(named or own)
    bare = re.sub(r"^(parallel|aec):", "", given.strip())
    last = re.split(r"[/\\]", re.sub(r":[^:/\\]*$", "", bare))[-1]
    last = last.removesuffix(".py") if last.endswith(".py") else last.rpartition(".")[2]
    return re.sub(r"[^\w.-]+", "_", last).strip("._-") or "environment"


def command_of(given: object, spec: Spec, changed: Mapping[str, Any]) -> str | None:
    """The command line that plays the same again; None where there is none."""
    if isinstance(given, str | PathLike) and _read(given) is not None:
        words = ["gamekeeper", "evaluate", quote(str(fspath(given)))]
    elif isinstance(given, str):
        words = ["gamekeeper", "evaluate", quote(given)]
        for name, policy in spec.policies.items():
            if policy.is_method or policy.environments or len(policy.runs) != 1:
                return None
            for place, choice in policy.runs[0].items():
                if not isinstance(choice, str):
                    return None
                text = choice if place == EVERYONE else f"{place}={choice}"
                is_own = len(policy.runs[0]) == 1 and place == EVERYONE and choice == name
                words += ["--policy", quote(text if is_own else f"{name}:={text}")]
        if any(environment.kwargs for environment in spec.environments.values()):
            return None
    else:
        return None
    for key in ("episodes", "seed"):
        if changed.get(key) is not None:
            words += [f"--{key}", str(changed[key])]
    if changed.get("crossplay") is True:
        words.append("--crossplay")
    return " ".join(words)
