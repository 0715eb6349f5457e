"""The game form: what is declared beside what was measured, and who moves whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow.compute as pc

from gamekeeper.core.evidence import Evidence
from gamekeeper.report.measured_text import APART, BY_AGENT, DECLARED, declared_as, words
from gamekeeper.report.page.data import Block, Cell, Section, Table, name, number
from gamekeeper.report.page.figures import Figures
from gamekeeper.report.page.influence import influence_blocks
from gamekeeper.report.page.pack import Seat
from gamekeeper.report.space_text import space_text

APIS: Final = {"aec": "AEC, agents take turns", "parallel": "Parallel, agents act together"}
FIRST_EPISODES: Final = 20
"""Episodes in which the order of turns is looked at."""


def form_section(
    evidence: Evidence,
    figures: Figures,
    seats: Sequence[Seat],
    *,
    audit: Mapping[str, Any] | None,
    attribution: Mapping[str, Any] | None,
) -> Section:
    """What the contract declares beside what an audit measured, or what the run alone shows."""
    declared = (audit or {}).get("declared") or evidence.manifest.get("contract") or {}
    source = "measured by the audit" if audit else "seen in this run"
    measured = (audit or {}).get("measured") or seen_form(evidence, figures)
    influence = ((audit or {}).get("measured") or {}).get("influence")
    whose = "the audit replaced actions of random play"
    if not influence and attribution is not None:
        influence, whose = attribution.get("influence"), "single actions of this run were replaced"
    return Section(
        "form",
        "The game form",
        (
            Block(
                facts=tuple(_facts(evidence, declared)),
                tables=(_beside(measured, declared, source), _measured_agents(measured)),
                alerts=tuple(_strangers(audit, evidence)),
                notes=tuple(_notes(audit, measured)),
            ),
            Block(title="Agents and spaces", tables=(_spaces(evidence, figures, seats),)),
            *influence_blocks(influence or (), whose),
        ),
    )


def _facts(evidence: Evidence, declared: Mapping[str, Any]) -> list[tuple[str, str]]:
    api = (evidence.manifest.get("environment") or {}).get("api")
    facts = [("API", APIS.get(str(api), str(api)))]
    if declared.get("why"):
        facts.append(("why", str(declared["why"])))
    failure = declared.get("failure") or {}
    if isinstance(failure, Mapping) and failure:
        text = "; ".join(f"{scope}: {condition}" for scope, condition in failure.items())
        facts.append(("failed when", text))
    if not declared:
        facts.append(("contract", "none: nothing is declared, so nothing of it can be broken"))
    return facts


def _strangers(audit: Mapping[str, Any] | None, evidence: Evidence) -> list[str]:
    """An audit of another environment than the run's is told, never passed over."""
    if audit is None:
        return []
    mine = set(map(str, evidence.manifest.get("agents") or ()))
    if mine & set(audit.get("agents") or mine):
        return []
    ran = (evidence.manifest.get("environment") or {}).get("entry_point")
    return [f"The audit is of {audit.get('environment')}, and this run of {ran}: no agent of the "
            "one is in the other."]  # fmt: skip


def _notes(audit: Mapping[str, Any] | None, measured: Mapping[str, Any]) -> list[str]:
    if audit is None:
        return [
            "A recorded run shows what happened, not what would have: determinism, order and "
            "influence are measured by `gamekeeper audit ENV`."
        ]
    advised = str(measured.get("advice"))
    return [f"Advice: {APIS[advised]}. {measured.get('why') or ''}"] if advised in APIS else []


def _beside(measured: Mapping[str, Any], declared: Mapping[str, Any], source: str) -> Table:
    keys = dict.fromkeys([*(key for key in measured if key not in APART), *DECLARED])
    rows = tuple(
        (
            Cell(key.replace("_", " ")),
            Cell(words(measured.get(key)) or "not seen"),
            Cell(words(declared_as(declared, key)) or "not declared"),
        )
        for key in keys
    )
    return Table("Declared beside measured", ("", source, "declared"), rows)


def _measured_agents(measured: Mapping[str, Any]) -> Table:
    """What was measured agent by agent."""
    tables = [each[BY_AGENT] for each in measured.values()
              if isinstance(each, Mapping) and isinstance(each.get(BY_AGENT), Mapping)]  # fmt: skip
    agents = list(dict.fromkeys(agent for table in tables for agent in table))
    keys = list(dict.fromkeys(key for table in tables for row in table.values() for key in row))
    merged = {agent: {k: v for table in tables for k, v in table.get(agent, {}).items()}
              for agent in agents}  # fmt: skip
    rows = tuple((name(agent), *(_figure(merged[agent].get(key)) for key in keys))
                 for agent in agents)  # fmt: skip
    return Table("By agent", ("agent", *(key.replace("_", " ") for key in keys)), rows)


def _figure(value: Any) -> Cell:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return number(value) if is_number else Cell(words(value))


def _spaces(evidence: Evidence, figures: Figures, seats: Sequence[Seat]) -> Table:
    rows = []
    for seat in seats:
        spaces = evidence.spaces.get(seat.name)
        sides = (None, None) if spaces is None else (spaces.observation, spaces.action)
        rows.append((
            name(seat.name), name(seat.role),
            *(Cell("?" if each is None else space_text(each.space), "code") for each in sides),
            Cell("-" if seat.noop is None else str(seat.noop), "code"),
            number(_episodes(figures, seat.name)),
        ))  # fmt: skip
    columns = ("agent", "role", "observes", "acts", "noop", "episodes")
    return Table("Agents and spaces", columns, tuple(rows))


def _episodes(figures: Figures, agent: str) -> int:
    if agent not in figures.agents:
        return 0
    return int(figures.present[:, figures.agents.index(agent)].sum())


# -- what a run alone shows


def seen_form(evidence: Evidence, figures: Figures) -> dict[str, Any]:
    """The form as far as a recorded run shows it, by the names that an audit uses."""
    api = (evidence.manifest.get("environment") or {}).get("api")
    ended = [header for header in figures.headers if header.get("end") == "ended"]
    turns = [header["turns"] for header in ended if header.get("turns") is not None]
    counts = figures.present.sum(axis=1)
    return {
        "schedule": {"acts": "together", "order": "none"}
        if api == "parallel"
        else {"acts": "in turns", "order": _order(evidence, figures)},
        "horizon": _horizon(figures),
        "roster": f"{_span(counts)} agents in an episode",
        "turns": _span(turns) if turns else None,
        "reward": _rewards(figures),
        "endings": _endings(figures),
    }


def _span(values: Any) -> str:
    listed = [int(value) for value in values]
    if not listed:
        return "no"
    low, high = min(listed), max(listed)
    return str(low) if low == high else f"{low} to {high}"


def _order(evidence: Evidence, figures: Figures) -> str | None:
    """Whether the rounds of the first episodes all had one order of agents."""
    seen: set[tuple[str, ...]] = set()
    for header in figures.headers[:FIRST_EPISODES]:
        trace = evidence.trace_of(header)
        steps = trace.steps.filter(pc.is_valid(trace.steps["order"]))
        for group in _rounds(steps["agent"].to_pylist()):
            seen.add(tuple(group))
    whole = max(map(len, seen), default=0)
    full = {group for group in seen if len(group) == whole}
    if whole < 2:
        return None
    return "fixed" if len(full) == 1 else "varies"


def _rounds(actors: Sequence[str]) -> list[list[str]]:
    """Turns up to the next one of an agent that has had its turn."""
    rounds: list[list[str]] = [[]]
    for agent in actors:
        if agent in rounds[-1]:
            rounds.append([])
        rounds[-1].append(agent)
    return rounds


def _horizon(figures: Figures) -> int | None:
    """The turns after which episodes were truncated, where there were two at least, all alike."""
    turns = [
        header.get("turns")
        for place, header in enumerate(figures.headers)
        if header.get("end") == "ended" and figures.truncated[place].any()
        and not figures.terminated[place].any()
    ]  # fmt: skip
    return turns[0] if len(turns) > 1 and len(set(turns)) == 1 else None


def _rewards(figures: Figures) -> dict[str, Any] | None:
    if not figures.agents:
        return None
    totals = np.where(figures.present, figures.returns, 0.0)
    alike = bool(len(figures.agents) > 1 and np.allclose(totals, totals[:, :1]))
    found: dict[str, Any] = {"returns": "alike for all agents" if alike else "differ by agent"}
    return found | ({"terms": list(figures.terms)} if figures.terms else {})


def _endings(figures: Figures) -> dict[str, Any]:
    there = figures.present
    terminated = int((figures.terminated & there).sum())
    truncated = int((figures.truncated & ~figures.terminated & there).sum())
    return {
        "terminated": terminated,
        "truncated": truncated,
        "neither": int(there.sum()) - terminated - truncated,
    }
