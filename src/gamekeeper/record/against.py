"""What of a run still holds: what it was recorded with, beside what is installed now.

Every part is *holds*, *stale* (it has changed, so what hangs on it must be measured again) or
*unknown* (only a replay, or somebody who trusts code that evidence names, can tell).
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Any, Final, Literal

from gamekeeper.core.canon import from_json
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.space.plain import space_to_json
from gamekeeper.errors import GamekeeperError, SpecError
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.draft import agent_specs
from gamekeeper.game.open import open_env
from gamekeeper.game.policy import distrust_policy
from gamekeeper.record.recording import cast_of
from gamekeeper.record.tasks import error_fields

Status = Literal["holds", "stale", "unknown"]

TASK: Final = "gamekeeper.record.against:now_task"
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


def now_task(
    report: Callable[..., None],
    *,
    spec: str,
    kwargs: str,
    contract: str | None,
    api: str | None,
    policies: Sequence[str],
) -> dict[str, Any]:
    """Opens an environment as it is installed now, in a worker, without a reset or a step.

    Args:
        spec: names the environment.
        kwargs: its arguments, in canonical JSON.
        contract: a contract's file in place of the one beside it.
        api: asked for where the spec asks for none.
        policies: names of policies whose versions are wanted.
    Returns:
        `identity`, `contract`, `spaces` by agent, `policies`: a version by name, or what was in
        the way as `{"error": text}`; or the fields of the `error` that was in the way of all.
    """
    del report
    try:
        given: Any = from_json(kwargs)
        opened = _opened(spec, api, given)
        try:
            declared = declared_contract(contract, opened)
            from gamekeeper.core.contract import Contract

            specs = agent_specs(opened.env, declared or Contract())
            versions = {name: _version(name, opened.env, declared) for name in policies}
        finally:
            opened.env.close()
    except GamekeeperError as error:
        return {"error": error_fields(error)}
    return {
        "error": None,
        "identity": opened.identity,
        "contract": None if declared is None else declared.to_json(),
        "spaces": {
            each.name: {
                "observation": _space(each.observation_space), "action": _space(each.action_space)
            }
            for each in specs
        },
        "policies": versions,
    }  # fmt: skip


def policies_of(evidence: Evidence) -> dict[tuple[str, str | None], list[str]]:
    """Who was played by which policy and version: agents' names by both; empty if not named."""
    found: dict[tuple[str, str | None], dict[str, None]] = {}
    for text in evidence.episodes["policies"].unique().to_pylist():
        try:
            named = json.loads(text or "{}")
            rows = [(a, (str(e["policy"]), e.get("version"))) for a, e in named.items()]
        except (ValueError, TypeError, KeyError, AttributeError):  # nothing that a recorder wrote
            continue
        for agent, key in rows:
            found.setdefault(key, {})[str(agent)] = None
    return {key: list(agents) for key, agents in found.items()}


def askable(names: Sequence[str], *, allow_import: bool) -> list[str]:
    """The policies whose version may be looked up: those that are code only where it is allowed."""
    return [name for name in names if allow_import or distrust_policy(name) is None]


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
    record = _record_command(evidence, played, environment, kwargs)
    audit = shlex.join(["gamekeeper", "audit", environment, *_kwargs_words(then, kwargs)])
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


def _policy_rows(
    played: Mapping[tuple[str, str | None], Sequence[str]], now: Mapping[str, Any], command: str
) -> Iterator[Standing]:
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


def _record_command(
    evidence: Evidence,
    played: Mapping[tuple[str, str | None], Sequence[str]],
    environment: str,
    kwargs: str | None,
) -> str:
    """What records the same anew, as far as the run says how it was played."""
    manifest = evidence.manifest
    words = ["gamekeeper", "record", environment]
    words += _kwargs_words(manifest.get("environment") or {}, kwargs)
    names = {name for name, _ in played}
    if len(names) == 1:
        words += ["--policy", next(iter(names))] if names != {"random"} else []
    else:
        words += [w for (name, _), agents in played.items() for agent in agents
                  for w in ("--policy", f"{agent}={name}")]  # fmt: skip
    words += ["--episodes", str(evidence.episodes.num_rows)]
    words += ["--seed", str(manifest["seed"])] if manifest.get("seed") is not None else []
    words += ["--level", "digest"] if manifest.get("level") == "digest" else []
    return shlex.join([*words, "--out", f"{evidence.path}-again"])


def _kwargs_words(then: Mapping[str, Any], kwargs: str | None) -> list[str]:
    given = kwargs if kwargs is not None else json.dumps(then.get("kwargs") or {})
    return [] if given == "{}" else ["--kwargs", given]


def _opened(spec: str, api: str | None, kwargs: Mapping[str, Any]) -> Any:
    """The environment, behind the API that it was recorded with unless the spec names one."""
    if spec.startswith(("parallel:", "aec:")) or api is None:
        return open_env(spec, **kwargs)
    try:
        return open_env(spec, api=api, **kwargs)
    except SpecError:
        return open_env(spec, **kwargs)  # it has another API now: a row tells


def _version(name: str, env: Any, contract: Any) -> dict[str, str | None]:
    try:
        cast = cast_of(name, env, contract)
        agent = next(iter(getattr(env, "possible_agents", None) or ["*"]))
        return {"version": cast.described([agent])[str(agent)]["version"]}
    except GamekeeperError as error:
        return {"error": error.what}


def _space(space: Any) -> Any:
    return None if space is None else space_to_json(space)


def _same(one: Any, two: Any) -> bool:
    return json.dumps(one, sort_keys=True) == json.dumps(two, sort_keys=True)


def _shown(value: Any) -> str | None:
    if value is None or isinstance(value, str):
        return value
    return json.dumps(value, sort_keys=True)


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
