"""Sections of an audit: verdicts by severity, and the structure, declared beside measured."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow.compute as pc

from gamekeeper.checks.verdict import SEVERITIES
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.reporting.audit_text import broken_rule, finding_facts
from gamekeeper.reporting.crowd import MOST_ROWS
from gamekeeper.reporting.influence_text import lag_unit
from gamekeeper.reporting.measured_text import (
    APART,
    DECLARED,
    declared_as,
    measured_by_agent,
    unmeasured,
    words,
)
from gamekeeper.reporting.page.episode_figures import Figures
from gamekeeper.reporting.page.packed_episode import PackedAgent
from gamekeeper.reporting.page.page_data import (
    Cell,
    Chart,
    PageBlock,
    PageSection,
    PageTable,
    Verdicts,
    anchor_of,
    badge,
    matrix,
    name,
    number,
)
from gamekeeper.reporting.results_text import few
from gamekeeper.reporting.text_columns import space_text

ORDER: Final = ("suspected", "waived", "not_exercised", "passed", "not_applicable")
"""The outcomes that aren't failures, in the order in which they are shown."""
BAD: Final = ("failed", "error")


def verdicts_section(audit: Mapping[str, Any] | None) -> PageSection | None:
    """The verdict of every check; None without an audit."""
    if audit is None:
        return None
    judged = [_judged(each) for each in audit["verdicts"] if isinstance(each, Mapping)]
    bad = sorted((each for each in judged if each["outcome"] in BAD), key=_weight)
    rest = tuple(
        (outcome.replace("_", " "), tuple(each for each in judged if each["outcome"] == outcome))
        for outcome in ORDER
    )
    notes = (
        f"{audit.get('environment')}, {audit.get('steps')} steps, seed {audit.get('seed')}.",
        "Not exercised: the situation that the check judges didn't occur. This isn't a pass.",
    )
    failed = [each for each in audit["verdicts"] if each.get("outcome") == "failed"]
    found = Verdicts(
        _summary(judged, failed_words(failed)),
        tuple(bad),
        tuple((o, each) for o, each in rest if each),
        notes,
    )
    return PageSection("verdicts", "Verdicts", verdicts=found)


def failed_words(failed: Sequence[Mapping[str, Any]]) -> str:
    """Number of failed checks, causes and those that follow from them apart."""
    follow = sum(bool(each.get("follows_from")) for each in failed)
    causes = len(failed) - follow
    if not follow:
        return f"{len(failed)} failed"
    counted = f"{causes} cause{'' if causes == 1 else 's'}"
    rest = f"{follow} follow{'s' if follow == 1 else ''} from {'it' if causes == 1 else 'them'}"
    return f"{len(failed)} failed: {counted}, {rest}"


def _summary(judged: Sequence[Mapping[str, Any]], failed: str) -> tuple[Cell, ...]:
    """Numbers of verdicts by outcome; `failed`: words for those that failed."""
    counts = dict.fromkeys((*BAD, *ORDER), 0)
    for each in judged:
        counts[each["outcome"]] = counts.get(each["outcome"], 0) + 1
    return tuple(
        badge(failed if outcome == "failed" else f"{count} {outcome.replace('_', ' ')}", outcome)
        for outcome, count in counts.items()
        if count
    )


def _weight(judged: Mapping[str, Any]) -> tuple[int, int, str]:
    severity = judged["severity"]
    place = SEVERITIES.index(severity) if severity in SEVERITIES else len(SEVERITIES)
    return (BAD.index(judged["outcome"]), place, judged["id"])


def _judged(verdict: Mapping[str, Any]) -> dict[str, Any]:
    """The verdict with what the page says in other words; a broken rule as what should hold."""
    plain = {key: str(verdict.get(key) or "") for key in ("id", "outcome", "severity", "reason")}
    broken = plain["outcome"] in ("failed", "suspected")
    findings = [
        {
            "facts": list(finding_facts(each).items()),
            "program": str(each.get("reproducer") or ""),
            "anchor": f"program-{anchor_of(plain['id'])}-{k}",
        }
        for k, each in enumerate(verdict.get("findings") or ())
    ]
    claim = broken_rule(verdict) if broken else str(verdict.get("claim", ""))
    return {**plain, "claim": claim, "cases": _cases(verdict), "findings": findings}


def _cases(verdict: Mapping[str, Any]) -> str:
    """`0 of 40 cases failed; could miss a fault that shows in fewer than 7.2 % of cases`."""
    text = f"{verdict.get('failed') or 0:,} of {verdict.get('cases', 0):,} cases failed"
    share = verdict.get("could_miss")
    if share is None:
        return text
    return f"{text}; could miss a fault that shows in fewer than {100 * share:.2g} % of cases"


KINDS: Final = ("mask", "observation", "reward", "ending")
MOST_AGENTS: Final = 40
"""Agents of a matrix; of more, the strongest pairs are listed."""
MOST_PAIRS: Final = 30


def influence_blocks(
    rows: Sequence[Mapping[str, Any]], method: str, *, lag: str
) -> tuple[PageBlock, ...]:
    """Influence of agents on observations, rewards and endings of agents: a matrix for each.

    Args:
        rows: as an audit or an attribution measured them.
        method: the way in which they were measured, in words.
        lag: unit of the lags: `steps` or `rounds`.
    """
    rows = [row for row in rows if isinstance(row, Mapping)]
    if not rows:
        return ()
    agents = list(dict.fromkeys([*(row["from"] for row in rows), *(row["to"] for row in rows)]))
    note = (
        f"The share of replaced actions of one agent (row) that changed something for another "
        f"(column), at the first lag at which something changed: {method}, compared with the "
        "unchanged rerun. In brackets its 95 % interval; +1: one "
        f"{lag.removesuffix('s')} later."
    )
    if len(agents) > MOST_AGENTS:
        table = _pairs(rows, lag)
        return (PageBlock(title="Influence", notes=(note,), tables=(table,), anchor="influence"),)
    charts = tuple(filter(None, (_influence(rows, agents, kind) for kind in KINDS)))
    block = PageBlock(title="Influence", notes=(note,), charts=charts, anchor="influence")
    return (
        block,
        PageBlock(title="All measured influences", tables=(_pairs(rows, lag),), folded=True),
    )


def _influence(rows: Sequence[Mapping[str, Any]], agents: Sequence[str], kind: str) -> Chart | None:
    best: dict[tuple[str, str], Mapping[str, Any]] = {}
    for row in rows:
        key = (row["from"], row["to"])
        if row["on"] == kind and (key not in best or _first(row) < _first(best[key])):
            best[key] = row
    if not best:
        return None
    grid = [[best.get((one, two)) for two in agents] for one in agents]
    return matrix(
        f"influence-{kind}",
        f"Influence on the {kind}",
        agents,
        agents,
        [[None if cell is None else cell["p"] for cell in line] for line in grid],
        labels=("action of", f"{kind} of"),
        texts=[[None if cell is None else _share(cell) for cell in line] for line in grid],
        limits=(0.0, 1.0),
    )


def _first(row: Mapping[str, Any]) -> tuple[bool, int]:
    """Order of lags: those at which something changed, the earliest of them first."""
    return not row["p"], row["lag"]


def _share(row: Mapping[str, Any]) -> str:
    later = f" +{row['lag']}" if row["lag"] and row["p"] else ""
    return f"{row['p']:.0%}{later} ({row['low']:.0%} to {row['high']:.0%})"


def _pairs(rows: Sequence[Mapping[str, Any]], lag: str) -> PageTable:
    ordered = sorted(rows, key=lambda row: -float(row["p"]))
    shown = tuple(
        (
            name(row["from"]),
            name(row["to"]),
            Cell(str(row["on"])),
            number(row["lag"]),
            Cell(f"{row['p']:.0%}", "number"),
            Cell(f"{row['low']:.0%} to {row['high']:.0%}", "number"),
            number(row["n"]),
        )
        for row in ordered[:MOST_PAIRS]
    )
    more = len(ordered) - len(shown)
    columns = ("from", "to", "on", f"{lag} later", "changed", "95 % interval", "n")
    note = f"The strongest {MOST_PAIRS}; {more} more were measured." if more > 0 else ""
    return PageTable("Measured influences, the strongest first", columns, shown, note)


APIS: Final = {
    "aec": "AEC, agents take turns",
    "parallel": "Parallel, agents act together",
    "either": "AEC and Parallel fit alike",
}
FIRST_EPISODES: Final = 20
"""Episodes from which the order of turns is read."""


def form_section(
    evidence: Evidence,
    figures: Figures,
    roster: Sequence[PackedAgent],
    *,
    audit: Mapping[str, Any] | None,
    attribution: Mapping[str, Any] | None,
) -> PageSection:
    """The declared form beside the form that an audit measured, or that the run alone shows."""
    declared = (audit or {}).get("declared") or evidence.manifest.get("contract") or {}
    source = "measured by the audit" if audit else "measured in this run"
    measured = (audit or {}).get("measured") or form_of_run(evidence, figures)
    influence = ((audit or {}).get("measured") or {}).get("influence")
    method = "the audit replaced actions of random policies"
    lag = lag_unit(str((evidence.manifest.get("environment") or {}).get("api")))
    if not influence and attribution is not None:
        influence, method = attribution.get("influence"), "single actions of this run were replaced"
        lag = "steps"
    return PageSection(
        "form",
        "Structure",
        (
            PageBlock(
                facts=tuple(_facts(evidence, declared)),
                tables=(_beside(measured, declared, source), _measured_agents(measured)),
                alerts=tuple(_other_environment(audit, evidence)),
                notes=tuple(_notes(audit, measured)),
            ),
            PageBlock(title="Agents and spaces", tables=(_spaces(evidence, figures, roster),)),
            *influence_blocks(influence or (), method, lag=lag),
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
        facts.append(("contract", "none: only PettingZoo's rules are checked"))
    return facts


def _other_environment(audit: Mapping[str, Any] | None, evidence: Evidence) -> list[str]:
    """An alert where the audit is of another environment than the run."""
    if audit is None:
        return []
    mine = set(map(str, evidence.manifest.get("agents") or ()))
    if mine & set(audit.get("agents") or mine):
        return []
    recorded = (evidence.manifest.get("environment") or {}).get("entry_point")
    return [
        f"The audit is of {audit.get('environment')}, and this run of {recorded}: they have no "
        "agent in common."
    ]


def _notes(audit: Mapping[str, Any] | None, measured: Mapping[str, Any]) -> list[str]:
    if audit is None:
        return [
            "A recorded run shows what happened, not what would have: determinism, order and "
            "influence are measured by `gamekeeper audit ENV`."
        ]
    advised = str(measured.get("advice"))
    return [f"Advice: {APIS[advised]}. {measured.get('why') or ''}"] if advised in APIS else []


def _beside(measured: Mapping[str, Any], declared: Mapping[str, Any], source: str) -> PageTable:
    keys = dict.fromkeys([*(key for key in measured if key not in APART), *DECLARED])
    rows = tuple(
        (
            Cell(key.replace("_", " ")),
            Cell(words(measured.get(key)) or unmeasured(measured, key)),
            Cell(words(declared_as(declared, key)) or "not declared"),
        )
        for key in keys
    )
    return PageTable("Declared beside measured", ("property", source, "declared"), rows)


def _measured_agents(measured: Mapping[str, Any]) -> PageTable:
    """The measured figures of each agent."""
    by_agent = measured_by_agent(measured)
    keys = list(dict.fromkeys(key for row in by_agent.values() for key in row))
    rows = tuple(
        (name(agent), *(_figure(row.get(key)) for key in keys)) for agent, row in by_agent.items()
    )
    return PageTable("By agent", ("agent", *(key.replace("_", " ") for key in keys)), rows)


def _figure(value: Any) -> Cell:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return number(value) if is_number else Cell(words(value))


def _spaces(evidence: Evidence, figures: Figures, roster: Sequence[PackedAgent]) -> PageTable:
    """A row for each agent; of a crowd one for all that have the same."""
    alike: dict[tuple[tuple[Cell, ...], int | None], list[str]] = {}
    for place, member in enumerate(roster):
        spaces = evidence.spaces.get(member.name)
        sides = (None, None) if spaces is None else (spaces.observation, spaces.action)
        cells = (
            name(member.role),
            *(Cell("?" if each is None else space_text(each.space), "code") for each in sides),
            Cell("-" if member.noop is None else str(member.noop), "code"),
            number(_episodes(figures, member.name)),
        )
        key = (cells, None if len(roster) > MOST_ROWS else place)
        alike.setdefault(key, []).append(member.name)
    columns = ("agent", "role", "observes", "acts", "noop", "episodes")
    rows = tuple((name(few(agents, most=3)), *cells) for (cells, _), agents in alike.items())
    return PageTable("Agents and spaces", columns, rows)


def _episodes(figures: Figures, agent: str) -> int:
    if agent not in figures.agents:
        return 0
    return int(figures.present[:, figures.agents.index(agent)].sum())


# -- the form that a run alone shows


def form_of_run(evidence: Evidence, figures: Figures) -> dict[str, Any]:
    """The form as far as a recorded run shows it, by the names that an audit uses."""
    api = (evidence.manifest.get("environment") or {}).get("api")
    ended = [header for header in figures.headers if header.get("end") == "ended"]
    turns = [header["turns"] for header in ended if header.get("turns") is not None]
    counts = figures.present.sum(axis=1)
    return {
        "order": "none" if api == "parallel" else _order(evidence, figures),
        "horizon": _horizon(figures),
        "roster": f"{agents_text(_span(counts))} in an episode",
        "steps": _span(turns) if turns else None,
        "reward": _rewards(figures),
        "endings": _endings(figures),
    }


def agents_text(count: object) -> str:
    """`1 agent`, `3 agents`, `2 to 5 agents`."""
    return f"{count} agent{'' if str(count) == '1' else 's'}"


def _span(values: Any) -> str:
    listed = [int(value) for value in values]
    if not listed:
        return "no"
    low, high = min(listed), max(listed)
    return str(low) if low == high else f"{low} to {high}"


def _order(evidence: Evidence, figures: Figures) -> str | None:
    """`fixed` if the rounds of the first episodes all have one order of agents, else `varies`."""
    orders: set[tuple[str, ...]] = set()
    for header in figures.headers[:FIRST_EPISODES]:
        episode = evidence.episode_of(header)
        steps = episode.steps.filter(pc.is_valid(episode.steps["order"]))
        for group in _rounds(steps["agent"].to_pylist()):
            orders.add(tuple(group))
    whole = max(map(len, orders), default=0)
    full = {group for group in orders if len(group) == whole}
    if whole < 2:
        return None
    return "fixed" if len(full) == 1 else "varies"


def _rounds(actors: Sequence[str]) -> list[list[str]]:
    """Splits turns into rounds: a new one starts when an agent acts again."""
    rounds: list[list[str]] = [[]]
    for agent in actors:
        if agent in rounds[-1]:
            rounds.append([])
        rounds[-1].append(agent)
    return rounds


def _horizon(figures: Figures) -> int | None:
    """The length of truncated episodes, where at least two are there and all have the same."""
    turns = [
        header.get("turns")
        for place, header in enumerate(figures.headers)
        if header.get("end") == "ended"
        and figures.truncated[place].any()
        and not figures.terminated[place].any()
    ]
    return turns[0] if len(turns) > 1 and len(set(turns)) == 1 else None


def _rewards(figures: Figures) -> dict[str, Any] | None:
    found: dict[str, Any] = {"terms": list(figures.terms)} if figures.terms else {}
    if len(figures.agents) > 1:
        totals = np.where(figures.present, figures.returns, 0.0)
        alike = np.allclose(totals, totals[:, :1])
        found = {"returns": "alike for all agents" if alike else "differ by agent"} | found
    return found or None


def _endings(figures: Figures) -> dict[str, Any]:
    there = figures.present
    terminated = int((figures.terminated & there).sum())
    truncated = int((figures.truncated & ~figures.terminated & there).sum())
    return {
        "agents terminated": terminated,
        "agents truncated": truncated,
        "agents of neither": int(there.sum()) - terminated - truncated,
    }
