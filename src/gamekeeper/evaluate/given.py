"""From what a user hands over to a specification: a file, a suite, plain data, an environment."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from shlex import quote
from typing import Any

from gamekeeper.errors import SpecError
from gamekeeper.evaluate.reading import read_file, read_spec
from gamekeeper.evaluate.spec import Spec
from gamekeeper.evaluate.suites import suite_named
from gamekeeper.game.opening.installed import FACTORY_NAMES


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
    more: dict[str, Any] = {}
    if found is None:
        if not policies:
            raise SpecError(
                "nobody is to be evaluated", where="policies", expected="policies by name",
                seen="none",
                mend="policies={'reference': 'reference', 'random': 'random'}; on a command line "
                "--policy reference --policy random",
            )  # fmt: skip
        row = {"spec": given, "kwargs": dict(env_kwargs or {})}
        row |= {} if contract is None else {"contract": contract}
        name = name_of(given)
        data = {"name": name, "environments": {name: row}, "policies": policies}
        found = read_spec(data, source="arguments")
    else:
        if env_kwargs or contract is not None:
            raise SpecError(
                "a specification says what its environments are given", where="env_kwargs",
                expected="none", seen="arguments", mend="write them under [environments.NAME]",
            )  # fmt: skip
        if policies:
            dummy = {"environments": dict.fromkeys(found.environments, "-")}
            more["policies"] = read_spec({**dummy, "policies": policies}).policies
    settings: dict[str, Any] = {
        "seeds": {k: v for k, v in (("run", seed), ("episodes", episodes)) if v is not None}
    }
    if crossplay is not None:
        settings["crossplay"] = crossplay
    if record is not None:
        settings["record"] = record
    return _with(replace(found, **more), settings)


def _with(spec: Spec, settings: Mapping[str, Any]) -> Spec:
    """The specification with some sections read from elsewhere."""
    data = {"environments": dict.fromkeys(spec.environments, "-"),
            "policies": dict.fromkeys(spec.policies, "-"), **settings}  # fmt: skip
    read = read_spec(data, source="arguments")
    more: dict[str, Any] = {}
    if "run" in settings["seeds"]:
        more["seed"] = read.seed
    if "episodes" in settings["seeds"]:
        more["episodes"] = read.episodes
    more |= {key: getattr(read, key) for key in ("crossplay", "record") if key in settings}
    return replace(spec, **more)


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
            choice = policy.runs[0].get("*") if policy.runs else None
            if policy.is_method or choice != name or len(policy.runs[0]) != 1:
                return None
            words += ["--policy", quote(name)]
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
