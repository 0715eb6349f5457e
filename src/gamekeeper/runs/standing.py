"""A run against an environment as it is now, and the policies and command that it names."""

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, TypeAlias

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.row_tables import html_table
from gamekeeper.interface.policy import EVERYONE, SAME

# -- The policies of a run, and the command that records the same anew

Played: TypeAlias = "Mapping[tuple[str, str | None], Sequence[str]]"
"""Agents' names by the name and version of their policy."""


def policies_of(evidence: Evidence) -> dict[tuple[str, str | None], list[str]]:
    """Agents' names by the name and version of their policy; empty if no policies are named."""
    found: dict[tuple[str, str | None], dict[str, None]] = {}
    for text in evidence.episode_table["policies"].unique().to_pylist():
        for agent, entry in _named(text).items():
            version = entry.get("version")
            key = str(entry["policy"]), None if version is None else str(version)
            found.setdefault(key, {})[agent] = None
    return {key: list(agents) for key, agents in found.items()}


def _named(text: str | None) -> dict[str, Mapping[str, Any]]:
    """The entries of an episode's policies by agent; empty for a text that no recorder wrote."""
    with suppress(ValueError, AttributeError):
        entries = {str(agent): entry for agent, entry in json.loads(text or "{}").items()}
        if all(isinstance(entry, dict) and "policy" in entry for entry in entries.values()):
            return entries
    return {}


def choices_in(text: str | None) -> dict[str, str]:
    """Returns the choices that give agents the policies that an episode names.

    They are keyed as they were chosen, and agents that shared an object share one again; empty
    where the episode names none.
    """
    choices: dict[str, str] = {}
    shared: dict[str, list[str]] = {}
    for agent, entry in _named(text).items():
        place, name = str(entry.get("chosen_for", agent)), str(entry["policy"])
        owner = place if entry.get("own") else str(entry.get("object", place))
        choices[owner] = name
        if place != owner:
            choices[place] = f"{SAME}{owner}"
        elif "own" not in entry and ":" in name:  # from before agents had an object each
            shared.setdefault(owner, []).append(agent)
    for owner, agents in shared.items():
        if len(agents) > 1:
            choices |= dict.fromkeys(agents, f"{SAME}{owner}")
    return choices


def choices_of(evidence: Evidence) -> dict[str, str]:
    """Returns the choices of policies of all episodes; of one place the last."""
    found: dict[str, str] = {}
    for text in evidence.episode_table["policies"].unique().to_pylist():
        found |= choices_in(text)
    return found


def policy_words(evidence: Evidence) -> list[str]:
    """Returns the options of a command line that choose the recorded policies again."""
    return [
        word
        for place, name in choices_of(evidence).items()
        for word in ("--policy", name if place == EVERYONE else f"{place}={name}")
    ]


def record_command(evidence: Evidence, environment: str, kwargs: str | None) -> str:
    """Command line that records the same anew, as far as the run names its arguments."""
    manifest = evidence.manifest
    words = ["gamekeeper", "rollout", environment]
    words += kwargs_words(manifest.get("environment") or {}, kwargs)
    words += policy_words(evidence)
    words += ["--episodes", str(evidence.episode_table.num_rows)]
    words += ["--seed", str(manifest["seed"])] if manifest.get("seed") is not None else []
    words += ["--level", "digest"] if manifest.get("level") == "digest" else []
    most = manifest.get("most_turns")
    words += [] if most is None else ["--most-turns", str(most)]
    return shlex.join([*words, "--out", f"{evidence.path}-again"])


def kwargs_words(then: Mapping[str, Any], kwargs: str | None) -> list[str]:
    """The option for the environment's arguments: as they were typed, else as recorded.

    Args:
        then: the recorded identity.
        kwargs: as typed; None: not at all.
    """
    given = kwargs if kwargs is not None else json.dumps(then.get("kwargs") or {})
    return [] if given == "{}" else ["--kwargs", given]


# -- A run against the environment as it is now: what it was recorded with, beside what is installed
#
# Every part is *holds*, *stale* (it has changed, so what depends on it must be measured again) or
# *unknown* (only a replay, or running code that evidence names, can tell).

Status = Literal["holds", "stale", "unknown"]

ALL: Final = "every rollout, and whatever was measured from them"
JUDGED: Final = "what the contract judges: the audit, failures, roles and terms in reports"
PLAYED: Final = "the episodes that it played"
REPLAY: Final = "nothing, if a replay comes out the same"
UNNAMED: Final = "not named"


@dataclass(frozen=True, slots=True)
class Standing:
    """One thing that a measurement depends on.

    Attributes:
        what: `source`, `kwargs`, `contract`, `version numpy`, `policy random`.
        recorded, now: as text; None where there is nothing.
        status: `holds`, `stale` or `unknown`.
        again: measurements to repeat; empty where it holds.
        command: command line that repeats them, or shows if that is needed.
    """

    what: str
    recorded: str | None
    now: str | None
    status: Status
    again: str = ""
    command: str = ""


@dataclass(frozen=True, slots=True)
class Against:
    """A run, or an evaluation, beside an environment as it is now.

    Attributes:
        environment: as it was named.
        rows: things that it depends on.
    """

    run: str
    environment: str
    rows: tuple[Standing, ...]

    @property
    def status(self) -> Status:
        """Stale where anything is, else unknown where anything is."""
        found = {row.status for row in self.rows}
        return "stale" if "stale" in found else "unknown" if "unknown" in found else "holds"

    @property
    def commands(self) -> tuple[str, ...]:
        """Command lines that measure stale things again, else those that show if any are stale."""
        return tuple(
            dict.fromkeys(r.command for r in self.rows if r.status == self.status and r.command)
        )

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper show RUN --against ENV --json` prints."""
        return {
            "run": self.run,
            "against": self.environment,
            "status": self.status,
            "holds": None if self.status == "unknown" else self.status == "holds",
            "rows": [asdict(row) for row in self.rows],
            "commands": list(self.commands),
        }

    def __str__(self) -> str:
        lines = [f"{self.status}: {self.run} against {self.environment}"]
        lines += [
            f"  {row.what}: {row.recorded} recorded, {row.now} now"
            for row in self.rows
            if row.status != "holds"
        ]
        return "\n".join([*lines, *(f"  $ {command}" for command in self.commands)])

    def _repr_html_(self) -> str:
        rows = [(row.what, row.recorded or "", row.now or "", row.status) for row in self.rows]
        return html_table([("", "recorded", "now", ""), *rows], caption=self.status)


def standing(
    evidence: Evidence, now: Mapping[str, Any], *, environment: str, kwargs: str | None
) -> Against:
    """Compares a run with its environment as it is installed now.

    Args:
        now: findings of `now_task`.
        environment: as it was named.
        kwargs: the arguments as they were typed; None: the recorded ones.
    """
    manifest = evidence.manifest
    then: Mapping[str, Any] = manifest.get("environment") or {}
    played = policies_of(evidence)
    record = record_command(evidence, environment, kwargs)
    audit = shlex.join(["gamekeeper", "audit", environment, *kwargs_words(then, kwargs)])
    replay = shlex.join(["gamekeeper", "replay", str(evidence.path), "--env", environment])
    rows = [
        *identity_rows(then, now["identity"], command=record, replay=replay),
        _spaces_row(manifest.get("spaces") or {}, now["spaces"], record),
        _contract_row(manifest.get("contract"), now["contract"], audit),
        *_policy_rows(played, now["policies"], record),
    ]
    return Against(str(evidence.path), environment, tuple(rows))


def identity_rows(
    then: Mapping[str, Any], now: Mapping[str, Any], *, command: str, replay: str
) -> Iterator[Standing]:
    """Name, API, arguments, entry point, source and versions of an environment.

    Args:
        then, now: identities.
        command: command line that measures again.
        replay: command line that shows if another version alone matters.
    """
    for what in ("name", "api", "kwargs"):
        one, two = _shown(then.get(what)), _shown(now.get(what))
        yield _row(what, one, two, "stale", ALL, command)
    # one file has one digest, whichever of its classes is opened
    one, two = _shown(then.get("entry_point")), _shown(now.get("entry_point"))
    yield _row("entry point", one, two, "unknown", REPLAY, replay)
    one, two = then.get("source_digest"), now.get("source_digest")
    if one is None or two is None:
        yield Standing("source", _shown(one), _shown(two), "unknown", REPLAY, replay)
    else:
        yield _row("source", str(one), str(two), "stale", ALL, command)
    versions, current = then.get("versions") or {}, now.get("versions") or {}
    for name in sorted(versions.keys() | current.keys()):
        one, two = _shown(versions.get(name)), _shown(current.get(name))
        yield _row(f"version {name}", one, two, "unknown", REPLAY, replay)


def _spaces_row(then: Mapping[str, Any], now: Mapping[str, Any], command: str) -> Standing:
    """The spaces of the agents of the run; others may have joined the roster since."""
    missing = [agent for agent in then if agent not in now]
    other = [agent for agent in then if agent in now and not _same(then[agent], now[agent])]
    agents = f"{len(then)} agents"
    if not missing and not other:
        return Standing("spaces", agents, "the same", "holds")
    parts = [f"{len(missing)} are missing: {_few(missing)}"] if missing else []
    parts += [f"{len(other)} have others: {_few(other)}"] if other else []
    return Standing("spaces", agents, "; ".join(parts), "stale", ALL, command)


def _contract_row(then: Any, now: Any, command: str) -> Standing:
    if then is None and now is None:
        return Standing("contract", None, None, "holds")
    if then is None or now is None:
        one, two = ("none" if each is None else "declared" for each in (then, now))
        return Standing("contract", one, two, "stale", JUDGED, command)
    other = sorted(k for k in then.keys() | now.keys() if not _same(then.get(k), now.get(k)))
    name = then.get("name") or "declared"
    if not other:
        return Standing("contract", name, "the same", "holds")
    seen = f"another under {', '.join(other)}"
    return Standing("contract", name, seen, "stale", JUDGED, command)


def _policy_rows(played: Played, now: Mapping[str, Any], command: str) -> Iterator[Standing]:
    if not played:
        yield Standing("policies", UNNAMED, None, "unknown", PLAYED, "")
    for (name, version), agents in played.items():
        what, recorded = f"policy {name}", f"{version or 'no version'} ({_few(agents)})"
        found = now.get(name)
        if found is None:
            reason = "code that evidence names; --allow-import looks at it"
            yield Standing(what, recorded, reason, "unknown", PLAYED)
        elif "error" in found:
            yield Standing(what, recorded, found["error"], "stale", PLAYED, command)
        elif found["version"] is None and version is None:
            yield Standing(what, recorded, "no version", "unknown", PLAYED)
        elif found["version"] == version:
            yield Standing(what, recorded, version, "holds")
        else:
            yield Standing(
                what, recorded, found["version"] or "no version", "stale", PLAYED, command
            )


def _row(
    what: str, one: str | None, two: str | None, otherwise: Status, again: str, command: str
) -> Standing:
    """A thing that holds if both texts are equal; its status is `otherwise` if they aren't."""
    if one == two:
        return Standing(what, one, two, "holds")
    return Standing(what, one, two, otherwise, again, command)


def _same(one: Any, two: Any) -> bool:
    return json.dumps(one, sort_keys=True) == json.dumps(two, sort_keys=True)


def _shown(value: Any) -> str | None:
    if value is None or isinstance(value, str):
        return value
    return json.dumps(value, sort_keys=True)


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
