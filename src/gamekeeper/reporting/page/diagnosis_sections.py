"""Section of causes: a diagnosis, effects against the unchanged rerun; and an attribution."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.reporting.attribution_text import (
    RECORDED,
    REPEATED,
    REPLACED,
    listening_text,
    team_sentence,
)
from gamekeeper.reporting.diagnosis_text import difference_place, effect_word
from gamekeeper.reporting.page.agent_section import lazy_cell
from gamekeeper.reporting.page.page_data import (
    Cell,
    Chart,
    PageBlock,
    PageSection,
    PageTable,
    anchor_of,
    badge,
    bounds,
    forest,
    headings,
    interval,
    name,
    number,
    percent,
)
from gamekeeper.reporting.results_text import few

Document = Mapping[str, Any]

ANSWERS: Final = {"isolated": "failed", "joint": "failed", "ambiguous": "warn"}
"""The badge of an answer; others are plain."""
ANSWERED: Final = ("answer", "labels", "component", "why", "success", "scope")
"""Fields of an answer that its row shows; agents that have them alike share a row."""
WORDS: Final = {"success": "share of successes", "return": "team's return"}


def diagnosis_blocks(document: Document, *, key: str) -> list[PageBlock]:
    """Answers of the diagnosis, interventions that were played, first differences."""
    answers = {**({"team": document["team"]} if document.get("team") else {}), **document["agents"]}
    counts = [
        f"{each['failed']} of {each['episodes']} episodes failed for {scope}"
        for scope, each in (document.get("recorded") or {}).items()
    ]
    note = (
        f"{'; '.join(counts)}. {document.get('episodes')} new episodes were played, seed "
        f"{document.get('seed')}. Effects are differences from unchanged reruns on the same seeds. "
        "An ideal substitute that restores success can isolate a cause; a perturbation that hurts "
        "only shows dependence."
    )
    contradictions = [
        f"Contradiction for {scope}: {each['why']}."
        for scope, each in (document.get("contradictions") or {}).items()
    ]
    # Agents with the same interventions and effects share a block.
    groups: dict[str, list[str]] = {}
    for agent, found in answers.items():
        groups.setdefault(repr((found["tested"], found["not_tested"])), []).append(agent)
    return [
        PageBlock(
            title="Diagnosis",
            notes=(*contradictions, note),
            tables=(_answers(answers),),
            anchor="diagnosis",
        ),
        PageBlock(
            title="First differences of counterfactuals", tables=(_counterfactuals(document, key),)
        ),
        *(block for names in groups.values() for block in _tested(names, answers[names[0]])),
    ]


def _answers(answers: Mapping[str, Document]) -> PageTable:
    groups: dict[str, list[str]] = {}
    for agent, found in answers.items():
        told = {key: found[key] for key in ANSWERED}
        groups.setdefault(repr((told, found.get("substitutes"))), []).append(agent)
    rows = tuple(
        (
            name(", ".join(agents)),
            badge(found["answer"], ANSWERS.get(found["answer"], "plain")),
            Cell(" and ".join(found["labels"]) or found["component"] or "-"),
            Cell(found["why"]),
            Cell(f"{found['success']['share']:.0%}", "number"),
            Cell(f"{found['success']['low']:.0%} to {found['success']['high']:.0%}", "number"),
            Cell(", ".join(found.get("substitutes") or ()) or "-", "code"),
            Cell(found["scope"]),
        )
        for agents in groups.values()
        for found in [answers[agents[0]]]
    )
    columns = headings(
        "agents | answer | cause | reason | success unchanged | 95 % interval | "
        "sufficient substitutes | judged by"
    )
    return PageTable("Answers by agent", columns, rows)


def _tested(names: Sequence[str], found: Document) -> Iterator[PageBlock]:
    """Yields the effects of what was played, then, folded, what wasn't, with its reasons."""
    measures = dict.fromkeys(_measure(each) for each in found["tested"])
    charts = tuple(_effects(names, found["tested"], measure) for measure in sorted(measures)[::-1])
    reasons: dict[str, list[str]] = {}
    for each in found["not_tested"]:
        reasons.setdefault(each["why"], []).append(each["label"])
    table = PageTable(
        "Not tested",
        ("labels", "reason"),
        tuple((Cell(", ".join(labels)), Cell(why)) for why, labels in reasons.items()),
    )
    if charts:
        yield PageBlock(title=f"Tested for {few(names)}", charts=charts)
    yield PageBlock(title=f"Not tested for {few(names)}", tables=(table,), folded=True)


def _measure(tested: Document) -> str:
    return str(tested.get("measure", "success"))


def _effects(names: Sequence[str], tested: Sequence[Document], measure: str) -> Chart:
    """The effects on one measure; shares of successes and returns have different axes."""
    rows = [
        {
            "name": each["intervention"],
            "group": f"{each['kind']}: {each['label'] or 'policy'}",
            **{key: each.get(key) for key in ("low", "high", "p")},
            "value": each["effect"],
            "text": effect_word(each),
        }
        for each in sorted(tested, key=lambda each: (each["kind"], each["label"] or ""))
        if _measure(each) == measure
    ]
    return forest(
        f"diagnosis-{measure}-{anchor_of(names[0])}",
        f"Effects on the {WORDS.get(measure, measure)} for {few(names)}",
        rows,
        label="effect, 95 % interval",
        note="p has a Holm correction for the number of interventions of one kind; each interval "
        "is of one alone.",
    )


def _counterfactuals(document: Document, key: str) -> PageTable:
    rows = tuple(
        (
            Cell(f"episode {each['episode']}"),
            Cell(each["intervention"], "code"),
            Cell(place, link=f"{key}/{each['episode']}/{each['turn']}")
            if place
            else Cell("no difference"),
            _restored(each["restored"]),
            _restored(each["restored_open"]),
        )
        for each in document.get("counterfactuals") or ()
        for place in [difference_place(each)]
    )
    columns = headings(
        "episode | intervention | first difference | counterfactual | "
        "if others repeat their actions"
    )
    return PageTable("Failed episodes and their counterfactuals", columns, rows)


def _restored(is_restored: bool) -> Cell:
    return badge("restored", "passed") if is_restored else badge("still fails", "failed")


def attribution_blocks(document: Document) -> list[PageBlock]:
    """Contributions of agents with intervals, lazy agents, penalties caused by others."""
    agents = document["agents"]
    charts = [
        _parts(agents, "difference", "Difference: a baseline replaces the agent, others react"),
        _parts(agents, "shapley", "Shapley value"),
    ]
    harmful = tuple(
        f"{agent} is harmful: {part.get('harmful_why')}"
        for agent, part in agents.items()
        if part.get("harmful")
    )
    lazy = tuple(
        f"{agent} is lazy: {part.get('lazy_why')}"
        for agent, part in agents.items()
        if part.get("lazy")
    )
    return [
        PageBlock(
            title="Attribution",
            alerts=(*harmful, *lazy),
            notes=(team_sentence(document), *_unknown_lazy(agents)),
            anchor="attribution",
            charts=tuple(chart for chart in charts if chart["rows"]),
            tables=(
                _contributions(agents),
                _penalties(document),
                _messages(document),
                _untested(document),
            ),
        )
    ]


def _unknown_lazy(agents: Mapping[str, Document]) -> list[str]:
    """Names the agents for which it isn't known if they are lazy, with the reason."""
    reasons: dict[str, list[str]] = {}
    for agent, part in agents.items():
        if part.get("lazy") is None:
            reasons.setdefault(str(part.get("lazy_why") or "no reason given"), []).append(agent)
    return [f"Not known if lazy: {few(names)}: {why}." for why, names in reasons.items()]


def _parts(agents: Mapping[str, Document], which: str, title: str) -> Chart:
    rows = [
        {
            "name": agent,
            **{key: part[which].get(key) for key in ("value", "low", "high", "p")},
            "text": f"n = {part[which]['n']}",
        }
        for agent, part in agents.items()
        if part.get(which)
    ]
    return forest(f"attribution-{which}", title, rows, label="team return, 95 % interval")


def _contributions(agents: Mapping[str, Document]) -> PageTable:
    rows = tuple(
        (
            name(agent),
            number(part["return"]),
            percent(part["share"]),
            percent(part["idle"]),
            *_measured(part.get("difference")),
            *_measured(part.get("shapley")),
            *_measured((part.get("turn") or {}).get("all")),
            lazy_cell(part.get("lazy")),
        )
        for agent, part in agents.items()
    )
    columns = headings(
        "agent | own return | share | idle | difference | 95 % interval | Shapley | "
        "95 % interval | all actions | 95 % interval | lazy"
    )
    note = (
        f"Of the recorded run, {'; '.join(RECORDED)}. With agents replaced in new episodes, "
        f"{'; '.join(REPLACED)}. With actions replaced while the others repeat theirs, "
        f"{REPEATED[1].replace('the same', 'mean team return that is lost')}."
    )
    return PageTable("Contributions of agents", columns, rows, note)


def _measured(part: Document | None) -> tuple[Cell, Cell]:
    if part is None:
        return number(None), bounds(None, None)
    between = interval(part["low"], part["high"]) or f"none, {part['n']} episodes"
    return number(part["value"]), Cell(between, "number")


def _penalties(document: Document) -> PageTable:
    rows = tuple(
        (
            name(row["agent"]),
            Cell(row["term"]),
            name(", ".join(row["by"])),
            Cell(f"{row['p']:.0%} of {row['n']}", "number"),
            Cell(f"{row['low']:.0%} to {row['high']:.0%}", "number"),
            Cell(f"episode {row['first']['episode']}, turn {row['first']['turn']}"),
        )
        for row in document.get("penalties") or ()
        if row.get("first")
    )
    columns = ("agent", "term", "caused by", "penalties", "95 % interval", "first")
    return PageTable("Penalties caused by another agent", columns, rows)


def _messages(document: Document) -> PageTable:
    rows = []
    for row in document.get("messages") or ():
        if row["kind"] == "listening":
            text = listening_text(row)
        else:
            text = f"{row['bits']:.2f} bits (p = {row['p']:.3f}, {row['n']} episodes)"
        pair = (name(row.get("from") or "-"), name(row.get("to") or "-"))
        rows.append((Cell(row["kind"]), *pair, Cell(text)))
    return PageTable("Messages", ("kind", "from", "to", "measured"), tuple(rows))


def _untested(document: Document) -> PageTable:
    rows = tuple(
        (Cell(str(each["what"])), Cell(str(each["why"])))
        for each in document.get("not_tested") or ()
    )
    return PageTable("Not tested", ("test", "reason"), rows)


def causes_section(
    diagnosis: Document | None, attribution: Document | None, *, key: str
) -> PageSection | None:
    """Causes of failure and contributions of agents; None where neither was looked for."""
    blocks = [] if diagnosis is None else diagnosis_blocks(diagnosis, key=key)
    blocks += [] if attribution is None else attribution_blocks(attribution)
    if not blocks:
        return None
    return PageSection("causes", "Causes and contributions", tuple(blocks))
