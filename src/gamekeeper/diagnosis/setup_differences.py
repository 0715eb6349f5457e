"""Differences between the set-ups of two runs, and set-ups that take some of them over."""

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Final, Literal

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.runs.standing import policies_of

Kind = Literal["environment", "argument", "option", "policy", "cut", "version"]
ABSENT: Final = "not given"
"""Value of an argument or option that a run doesn't name."""


@dataclass(frozen=True, slots=True, eq=False)
class SetupDifference:
    """One thing that differs between two runs.

    Attributes:
        name: as `n`, `latency[giver_0]`, `options.day`, `policy[carrier_0]`, `version numpy`.
        kind: `environment` (or its wrapper), `argument`, `option` of the resets, `policy`, `cut`
            (the most turns of an episode), or `version`, which is listed and not swapped.
        bad, good: the values.
        agents: whose it is; empty where it is nobody's own.
        path: keys under which it stands.
        command: what would try it, where it can't be swapped.
    """

    name: str
    kind: Kind
    bad: Any
    good: Any
    agents: tuple[str, ...] = ()
    path: tuple[str, ...] = ()
    command: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain data; values as texts."""
        return {
            "name": self.name,
            "kind": self.kind,
            "bad": value_text(self.bad),
            "good": value_text(self.good),
            "agents": list(self.agents),
            "command": self.command or None,
        }


def value_text(value: Any) -> str:
    """A value as a person types it."""
    return value if isinstance(value, str) else to_json(value)


def differences_of(
    bad: Setup, good: Setup, contract: Contract, agents: Sequence[str]
) -> tuple[SetupDifference, ...]:
    """Every difference that can be swapped, in the order of set-ups.

    Args:
        bad: what is to be explained.
        good: of the run that worked.
        contract: names roles.
        agents: those whose policies are compared.
    """
    found: list[SetupDifference] = []
    if bad.spec != good.spec:
        found.append(SetupDifference("environment", "environment", bad.spec, good.spec))
    found += _of_arguments(bad.kwargs, good.kwargs, agents)
    found += _of_options(bad.options, good.options)
    found += _of_policies(bad, good, contract, agents)
    if bad.most_turns != good.most_turns:
        found.append(SetupDifference("cut after", "cut", bad.most_turns, good.most_turns))
    return tuple(found)


def _of_arguments(
    bad: Mapping[str, Any], good: Mapping[str, Any], agents: Sequence[str]
) -> Iterator[SetupDifference]:
    """Arguments by name; of two mappings by their keys, which may be agents."""
    for name, one, two in _pairs(bad, good):
        inner = [each for each in (one, two) if isinstance(each, Mapping)]
        by_agent = any(set(each) & set(agents) for each in inner)
        if len(inner) == 2 or (by_agent and ABSENT in (one, two)):
            both = ({} if each is ABSENT else each for each in (one, two))
            for key, old, new in _pairs(*both):
                whose = (key,) if key in agents else ()
                yield SetupDifference(f"{name}[{key}]", "argument", old, new, whose, (name, key))
        else:
            yield SetupDifference(name, "argument", one, two, path=(name,))


def _pairs(bad: Mapping[str, Any], good: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    for name in sorted({*bad, *good}):
        one, two = bad.get(name, ABSENT), good.get(name, ABSENT)
        if to_json(one) != to_json(two):
            yield name, one, two


def _of_options(bad: tuple[Any, ...], good: tuple[Any, ...]) -> Iterator[SetupDifference]:
    """Options by name where each run has one value of each; else all of them at once."""
    one, two = _constant(bad), _constant(good)
    if one is not None and two is not None:
        for name, old, new in _pairs(one, two):
            yield SetupDifference(f"options.{name}", "option", old, new, path=(name,))
    elif to_json(bad) != to_json(good):
        yield SetupDifference("options", "option", bad, good)


def _constant(options: tuple[Any, ...]) -> Mapping[str, Any] | None:
    first = options[0] or {}
    is_one = isinstance(first, Mapping) and len({to_json(each or {}) for each in options}) == 1
    return first if is_one else None


def _of_policies(
    bad: Setup, good: Setup, contract: Contract, agents: Sequence[str]
) -> Iterator[SetupDifference]:
    for agent in agents:
        one, two = bad.policy_of(agent, contract), good.policy_of(agent, contract)
        if one != two and two is not None:
            yield SetupDifference(f"policy[{agent}]", "policy", one, two, (agent,))


def taken_over(bad: Setup, good: Setup, differences: Iterable[SetupDifference]) -> Setup:
    """The bad set-up with some differences as the good one has them."""
    return reduce(lambda setup, each: _taken(setup, good, each), differences, bad)


def _taken(setup: Setup, good: Setup, one: SetupDifference) -> Setup:
    if one.kind == "environment":
        return replace(setup, spec=good.spec)
    if one.kind == "cut":
        return replace(setup, most_turns=good.most_turns)
    if one.kind == "policy":
        return setup.with_policy(one.agents[0], one.good)
    if one.kind == "option" and not one.path:
        return replace(setup, options=good.options)
    if one.kind == "option":
        options = tuple(_with(each or {}, one.path, one.good) for each in setup.options)
        return replace(setup, options=tuple(each or None for each in options))
    return replace(setup, kwargs=_with(setup.kwargs, one.path, one.good))


def _with(given: Mapping[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """A mapping with another value under a path of keys, or without one."""
    name, *deeper = path
    if deeper:
        return {**given, name: _with(given.get(name) or {}, tuple(deeper), value)}
    if value is ABSENT:
        return {key: each for key, each in given.items() if key != name}
    return {**given, name: value}


def listed_only(bad: Evidence, good: Evidence) -> tuple[SetupDifference, ...]:
    """Differences that can't be swapped in one process: versions, sources, changed policy files."""
    found = []
    one, two = (each.manifest["environment"] for each in (bad, good))
    for name, old, new in _pairs(one.get("versions") or {}, two.get("versions") or {}):
        command = _install(name, new, bad)
        found.append(SetupDifference(f"version {name}", "version", old, new, command=command))
    if one.get("entry_point") == two.get("entry_point"):
        before, after = one.get("source_digest"), two.get("source_digest")
        if before != after:
            found.append(SetupDifference("source of the environment", "version", before, after))
    versions = [
        {agent: key for key, agents in policies_of(each).items() for agent in agents}
        for each in (bad, good)
    ]
    for agent in sorted({*versions[0]} & {*versions[1]}):
        (name, old), (other, new) = versions[0][agent], versions[1][agent]
        if name == other and old != new:
            found.append(
                SetupDifference(f"version of {name}", "version", old, new, agents=(agent,))
            )
    return tuple(found)


def _install(name: str, version: str, bad: Evidence) -> str:
    """Command that replays the bad run with another version installed."""
    if version == ABSENT or bad.path is None:
        return ""
    replay = shlex.join(["gamekeeper", "replay", str(bad.path)])
    if name == "python":
        return f"uv run --python {version} {replay}"
    return f"pip install {shlex.quote(f'{name}=={version}')} && {replay}"


def names_of(differences: Iterable[SetupDifference]) -> str:
    """Names, for a sentence."""
    return " and ".join(each.name for each in differences)
