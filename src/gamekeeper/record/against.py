"""What of a run still holds: what it was recorded with, beside what is installed now.

Every part is *holds*, *stale* (it has changed, so what hangs on it must be measured again) or
*unknown* (only a replay, or somebody who trusts code that evidence names, can tell).
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Any, Final, Literal

from gamekeeper.core.evidence import Evidence
from gamekeeper.record.played import Played, kwargs_words, policies_of, record_command

Status = Literal["holds", "stale", "unknown"]

ALL: Final = "every rollout, and whatever was measured from them"
JUDGED: Final = "what the contract judges: the audit, failures, roles and terms in reports"
PLAYED: Final = "the episodes that it played"
REPLAY: Final = "nothing, if a replay comes out the same"
UNNAMED: Final = "not named"


@dataclass(frozen=True, slots=True)
class Standing:
    """One thing that a measurement hangs on.

    Attributes:
        what: `source`, `kwargs`, `contract`, `version numpy`, `policy random`.
        recorded, now: as text; None where there is nothing.
        status: `holds`, `stale` or `unknown`.
        again: what must be measured again; empty where it holds.
        command: what does that, or tells.
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
        run: its folder.
        environment: as it was named.
        rows: what it hangs on.
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
        """What measures again what is stale, else what tells whether it is."""
        return tuple(
            dict.fromkeys(r.command for r in self.rows if r.status == self.status and r.command)
        )

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper show RUN --against ENV --json` prints."""
        return {
            "run": self.run, "against": self.environment, "status": self.status,
            "holds": None if self.status == "unknown" else self.status == "holds",
            "rows": [asdict(row) for row in self.rows], "commands": list(self.commands),
        }  # fmt: skip

    def __str__(self) -> str:
        lines = [f"{self.status}: {self.run} against {self.environment}"]
        lines += [f"  {row.what}: {row.recorded} recorded, {row.now} now"
                  for row in self.rows if row.status != "holds"]  # fmt: skip
        return "\n".join([*lines, *(f"  $ {command}" for command in self.commands)])

    def _repr_html_(self) -> str:
        head = ("", "recorded", "now", "")
        rows = [(row.what, row.recorded or "", row.now or "", row.status) for row in self.rows]
        heading = "".join(f"<th>{escape(text)}</th>" for text in head)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows
        )
        return f"<b>{self.status}</b><table><tr>{heading}</tr>{body}</table>"


def standing(
    evidence: Evidence, now: Mapping[str, Any], *, environment: str, kwargs: str | None
) -> Against:
    """What of a run still holds.

    Args:
        evidence: the run.
        now: what `now_task` found.
        environment: as it was named.
        kwargs: the arguments as they were typed; None: the recorded ones.
    """
    manifest = evidence.manifest
    then: Mapping[str, Any] = manifest.get("environment") or {}
    played = policies_of(evidence)
    record = record_command(evidence, played, environment, kwargs)
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
    """Name, API, arguments, source and versions of an environment.

    Args:
        then, now: identities.
        command: what measures again.
        replay: what tells where a version alone is another.
    """
    for what in ("name", "api", "kwargs"):
        one, two = _shown(then.get(what)), _shown(now.get(what))
        yield _equal(what, one, two, again=ALL, command=command)
    one, two = then.get("source_digest"), now.get("source_digest")
    if one is None or two is None:
        yield Standing("source", _shown(one), _shown(two), "unknown", REPLAY, replay)
    else:
        yield _equal("source", str(one), str(two), again=ALL, command=command)
    versions, current = then.get("versions") or {}, now.get("versions") or {}
    for name in sorted(versions.keys() | current.keys()):
        one, two = _shown(versions.get(name)), _shown(current.get(name))
        same = one == two
        yield Standing(
            f"version {name}", one, two, "holds" if same else "unknown",
            "" if same else REPLAY, "" if same else replay,
        )  # fmt: skip


def _spaces_row(then: Mapping[str, Any], now: Mapping[str, Any], command: str) -> Standing:
    """The spaces of those who played; others may have joined the roster since."""
    gone = [agent for agent in then if agent not in now]
    other = [agent for agent in then if agent in now and not _same(then[agent], now[agent])]
    told = f"{len(then)} agents"
    if not gone and not other:
        return Standing("spaces", told, "the same", "holds")
    parts = [f"{len(gone)} are gone: {_few(gone)}"] if gone else []
    parts += [f"{len(other)} have others: {_few(other)}"] if other else []
    return Standing("spaces", told, "; ".join(parts), "stale", ALL, command)


def _contract_row(then: Any, now: Any, command: str) -> Standing:
    if then is None and now is None:
        return Standing("contract", None, None, "holds")
    if then is None or now is None:
        one, two = ("none" if each is None else "declared" for each in (then, now))
        return Standing("contract", one, two, "stale", JUDGED, command)
    other = sorted(k for k in then.keys() | now.keys() if not _same(then.get(k), now.get(k)))
    if not other:
        return Standing("contract", then.get("name") or "declared", "the same", "holds")
    told = f"another under {', '.join(other)}"
    return Standing("contract", then.get("name") or "declared", told, "stale", JUDGED, command)


def _policy_rows(played: Played, now: Mapping[str, Any], command: str) -> Iterator[Standing]:
    if not played:
        yield Standing("policies", UNNAMED, None, "unknown", PLAYED,
                       "")  # fmt: skip
    for (name, version), agents in played.items():
        what, told = f"policy {name}", f"{version or 'no version'} ({_few(agents)})"
        found = now.get(name)
        if found is None:
            reason = "code that evidence names; --allow-import looks at it"
            yield Standing(what, told, reason, "unknown", PLAYED)
        elif "error" in found:
            yield Standing(what, told, found["error"], "stale", PLAYED, command)
        elif found["version"] is None and version is None:
            yield Standing(what, told, "no version", "unknown", PLAYED)
        else:
            same = found["version"] == version
            yield Standing(
                what, told, found["version"] or "no version", "holds" if same else "stale",
                "" if same else PLAYED, "" if same else command,
            )  # fmt: skip


def _equal(what: str, one: str | None, two: str | None, *, again: str, command: str) -> Standing:
    same = one == two
    return Standing(
        what, one, two, "holds" if same else "stale", "" if same else again,
        "" if same else command,
    )  # fmt: skip


def _same(one: Any, two: Any) -> bool:
    return json.dumps(one, sort_keys=True) == json.dumps(two, sort_keys=True)


def _shown(value: Any) -> str | None:
    if value is None or isinstance(value, str):
        return value
    return json.dumps(value, sort_keys=True)


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
