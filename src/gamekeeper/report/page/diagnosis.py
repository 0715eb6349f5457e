"""A diagnosis: effects against the sham with intervals, by cause and by agent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.report.page.charts import forest
from gamekeeper.report.page.data import Block, Cell, Chart, Table, badge, few, name

Document = Mapping[str, Any]

ANSWERS: Final = {"isolated": "broken", "joint": "broken", "compatible": "warn"}
"""The badge of an answer; others are plain."""
WORDS: Final = {"success": "share of successes", "return": "team's return"}


def diagnosis_blocks(document: Document, *, key: str) -> list[Block]:
    """Every agent's answer, every change that was played for it, where twins part."""
    everybody = {**({"team": document["team"]} if document.get("team") else {}),
                 **document["agents"]}  # fmt: skip
    counts = [
        f"{each['failed']} of {each['episodes']} episodes failed for {scope}"
        for scope, each in (document.get("recorded") or {}).items()
    ]
    told = (
        f"{'; '.join(counts)}. {document.get('episodes')} fresh episodes were played, seed "
        f"{document.get('seed')}. Effects are against the same seeds with nothing changed. A "
        "remedy that restores can name a cause; a stressor that hurts shows dependence only."
    )
    blocks = [Block(title="Diagnosis", notes=(told,), tables=(_answers(everybody),),
                    anchor="diagnosis")]  # fmt: skip
    for names in _alike(everybody):
        blocks.append(_tested(names, everybody[names[0]]))
    blocks.append(Block(title="Where twins part", tables=(_partings(document, key),)))
    return blocks


def _answers(everybody: Mapping[str, Document]) -> Table:
    rows = tuple(
        (
            name(who),
            badge(found["answer"], ANSWERS.get(found["answer"], "plain")),
            Cell(" and ".join(found["labels"]) or "-"),
            Cell(found["why"]),
            Cell(f"{found['success']['share']:.0%}", "number"),
            Cell(f"{found['success']['low']:.0%} to {found['success']['high']:.0%}", "number"),
            Cell(", ".join(found.get("remedies") or ()) or "-", "code"),
            Cell(found["scope"]),
        )
        for who, found in everybody.items()
    )
    columns = (
        "who", "answer", "cause", "why", "success as it is", "95 % interval", "least remedy",
        "judged by",
    )  # fmt: skip
    return Table("What is answered, agent by agent", columns, rows)


def _alike(everybody: Mapping[str, Document]) -> Iterator[list[str]]:
    """Those for whom the same changes were played with the same effects stand together."""
    groups: dict[str, list[str]] = {}
    for who, found in everybody.items():
        groups.setdefault(repr((found["tested"], found["not_tested"])), []).append(who)
    yield from groups.values()


def _tested(names: Sequence[str], found: Document) -> Block:
    title = few(names)
    measures = dict.fromkeys(_measure(each) for each in found["tested"])
    charts = tuple(_effects(names, found["tested"], measure) for measure in sorted(measures)[::-1])
    reasons: dict[str, list[str]] = {}
    for each in found["not_tested"]:
        reasons.setdefault(each["why"], []).append(each["label"])
    table = Table(
        "Not tested", ("labels", "why"),
        tuple((Cell(", ".join(labels)), Cell(why)) for why, labels in reasons.items()),
    )  # fmt: skip
    return Block(title=f"Tested for {title}", charts=charts, tables=(table,), folded=not charts)


def _measure(tested: Document) -> str:
    return str(tested.get("measure", "success"))


def _effects(names: Sequence[str], tested: Sequence[Document], measure: str) -> Chart:
    """The effects on one measure: shares of successes and returns have no axis in common."""
    rows = [
        {
            "name": each["change"],
            "group": f"{each['kind']}: {each['label']}",
            **{key: each.get(key) for key in ("low", "high", "p")},
            "value": each["effect"],
            "text": _mark(each),
        }
        for each in sorted(tested, key=lambda each: (each["kind"], each["label"]))
        if _measure(each) == measure
    ]
    return forest(
        f"diagnosis-{measure}-{_anchor(names[0])}",
        f"Effects on the {WORDS.get(measure, measure)} for {few(names)}", rows,
        label="effect, with its 95 % interval",
        note="p is corrected for the number of changes of one kind (Holm).",
    )  # fmt: skip


def _mark(tested: Document) -> str:
    if tested.get("restores"):
        return "restores"
    if tested.get("depends"):
        return "helps" if tested["effect"] > 0 else "hurts"
    return ""


def _anchor(text: str) -> str:
    return "".join(sign for sign in text if sign.isascii() and sign.isalnum()) or "x"


def _partings(document: Document, key: str) -> Table:
    rows = []
    for each in document.get("partings") or ():
        where = Cell("nowhere")
        if each["turn"] is not None:
            whom = "" if each["agent"] is None else f" of {each['agent']}"
            where = Cell(f"turn {each['turn']}, {each['field']}{whom}",
                         link=f"{key}/{each['episode']}/{each['turn']}")  # fmt: skip
        rows.append((
            Cell(f"episode {each['episode']}"), Cell(each["remedy"], "code"), where,
            _restored(each["restored"]), _restored(each["restored_open"]),
        ))  # fmt: skip
    columns = ("episode", "remedy", "first difference", "twin", "with the others' actions kept")
    return Table("Failing episodes and their twins under a remedy", columns, tuple(rows))


def _restored(is_restored: bool) -> Cell:
    return badge("restored", "kept") if is_restored else badge("still fails", "broken")
