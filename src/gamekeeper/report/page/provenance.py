"""Where a page's figures come from, and the commands that show them again."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.evidence import Evidence
from gamekeeper.errors import GamekeeperError
from gamekeeper.game.opening.identity import spec_of
from gamekeeper.report.page.data import Block, Cell, Section, Table, few
from gamekeeper.report.page.learning import profile_of

MOST_SEEDS: Final = 200
"""Episodes whose seeds are listed."""


def provenance_section(
    runs: Sequence[tuple[str, str, Evidence]], *, version: str, audit: Mapping[str, Any] | None
) -> Section:
    """Of every run what it is, which versions made it, its seeds, and the commands.

    Args:
        runs: letter, folder as it was named, evidence.
        version: of gamekeeper, which makes the page.
        audit: whose command is told too.
    """
    blocks = []
    for key, path, evidence in runs:
        blocks.append(
            Block(
                title=f"Run {key}: {path}" if len(runs) > 1 else "",
                facts=tuple(_facts(evidence)),
                snippets=(("Again", "\n".join(commands(evidence, path, audit))),),
                anchor=f"again-{key}",
            )
        )
        blocks.append(Block(title="Episodes and seeds", tables=(_seeds(evidence),), folded=True))
    if len(runs) > 1:
        lines = [f"gamekeeper diff {_quoted(runs[0][1])} {_quoted(each[1])}" for each in runs[1:]]
        blocks.append(
            Block(title="Compare", snippets=(("Compare", "\n".join(lines)),), anchor="compare")
        )
    blocks.append(Block(notes=(f"Made by gamekeeper {version}.",)))
    return Section("provenance", "Provenance", tuple(blocks))


def _facts(evidence: Evidence) -> list[tuple[str, str]]:
    manifest = evidence.manifest
    environment: Mapping[str, Any] = manifest.get("environment") or {}
    versions: Mapping[str, str] = environment.get("versions") or {}
    policies = dict.fromkeys(
        text for header in _some(evidence) for text in profile_of(header).values()
    )
    return [
        ("environment", f"{environment.get('name')} ({environment.get('entry_point')})"),
        ("arguments", json.dumps(environment.get("kwargs") or {}, sort_keys=True)),
        ("source digest", str(environment.get("source_digest") or "none")),
        ("contract", _contract(evidence)),
        ("status", str(manifest.get("status", "in memory"))),
        ("level", str(manifest.get("level"))),
        ("seed", "none" if manifest.get("seed") is None else str(manifest["seed"])),
        ("policies", few(policies) or "not named"),
        ("versions", ", ".join(f"{name} {versions[name]}" for name in sorted(versions))),
        ("fingerprint", evidence.fingerprint or "none yet"),
        ("of infos", str(manifest.get("info_fingerprint") or "none yet")),
    ]


def _some(evidence: Evidence) -> list[Mapping[str, Any]]:
    """The first and the last episode."""
    last = max(evidence.episodes.num_rows - 1, 0)
    return [
        *evidence.episodes.slice(0, 1).to_pylist(),
        *evidence.episodes.slice(last).to_pylist(),
    ]


def _contract(evidence: Evidence) -> str:
    return "none" if not evidence.manifest.get("contract") else evidence.contract.name or "unnamed"


def commands(evidence: Evidence, path: str, audit: Mapping[str, Any] | None) -> list[str]:
    """Lines that record the same again, replay it, verify it, audit its environment.

    What evidence names is quoted, so that a line does only what it shows.
    """
    run = _quoted(path)
    lines = [f"gamekeeper verify {run}", f"gamekeeper replay {run}"]
    try:
        spec = spec_of(evidence.manifest.get("environment") or {})
    except GamekeeperError:
        return [*lines, "# the environment was an object in memory: it can't be opened by name"]
    kwargs = (evidence.manifest.get("environment") or {}).get("kwargs") or {}
    given = f" --kwargs {_quoted(json.dumps(kwargs, sort_keys=True))}" if kwargs else ""
    record = (
        f"gamekeeper record {_quoted(spec)}{given}{_policies(evidence)}"
        f" --episodes {evidence.episodes.num_rows}"
    )
    seed = evidence.manifest.get("seed")
    if seed is not None:
        again = f"{path.rstrip('/')}-again"
        lines += [f"{record} --seed {seed} --out {_quoted(again)}",
                  f"gamekeeper diff {run} {_quoted(again)}"]  # fmt: skip
    audited = f" --seed {audit.get('seed')}" if audit is not None else ""
    return [*lines, f"gamekeeper audit {_quoted(spec)}{given}{audited}"]


def _policies(evidence: Evidence) -> str:
    """One option where all have the same policy, else one for each agent."""
    first = evidence.episodes.slice(0, 1).to_pylist()
    try:
        told = json.loads((first[0]["policies"] if first else None) or "{}")
        names = {agent: str(each["policy"]) for agent, each in told.items()}
    except (AttributeError, KeyError, TypeError, ValueError):
        return ""
    if len(set(names.values())) == 1:
        return f" --policy {_quoted(next(iter(names.values())))}"
    return "".join(f" --policy {_quoted(f'{agent}={each}')}" for agent, each in names.items())


def _quoted(text: str) -> str:
    """One word of a shell; line ends would end it, so they are shown."""
    return shlex.quote(text.replace("\n", "\\n").replace("\r", "\\r"))


def _seeds(evidence: Evidence) -> Table:
    headers = evidence.episodes.slice(0, MOST_SEEDS).to_pylist()
    rows = tuple(
        (
            Cell(str(header["episode"]), "number"),
            Cell("-" if header["seed"] is None else str(header["seed"]), "number"),
            Cell("" if header["turns"] is None else str(header["turns"]), "number"),
            Cell(str(header["end"] or "open")),
            Cell(header["fingerprint"] or "none yet", "code"),
        )
        for header in headers
    )
    more = evidence.episodes.num_rows - len(headers)
    note = f"The first {MOST_SEEDS}; {more} more are in the run." if more > 0 else ""
    columns = ("episode", "seed", "turns", "end", "fingerprint")
    return Table("Episodes and seeds", columns, rows, note)
