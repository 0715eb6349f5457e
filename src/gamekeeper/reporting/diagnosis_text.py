"""A diagnosis as text: the judged condition, the answer, the agents, and what was played for it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.contract.validation import one_line
from gamekeeper.reporting.differences_text import differences_text, effect_text
from gamekeeper.reporting.results_text import few
from gamekeeper.reporting.text_columns import INDENT, column_lines, item_lines, items_text, wrapped

TEAM: Final = "team"
EACH: Final = "agent"
"""Scope of a condition that stands for each agent by itself."""
FIELDS: Final = {"obs": "observation"}
"""Names of fields in words, where they are others."""


def diagnosis_text(document: Mapping[str, Any], *, width: int) -> str:
    """The answer for the team first; what holds for all agents is said once."""
    blocks = [*contradiction_lines(document, width), head_line(document, width)]
    if document.get("differences") is not None:
        blocks.append(differences_text(document, width=width))
        blocks += [_agents(document, width), _not_played(document, width)]
    else:
        blocks += [
            *_scopes(document, width),
            _agents(document, width),
            _responses(document, width),
            _perturbations(document, width),
            _not_tested(document, width),
            _not_played(document, width),
            _counterfactuals(document["counterfactuals"], width),
        ]
    return "\n\n".join(filter(None, blocks))


def contradiction_lines(document: Mapping[str, Any], width: int) -> Iterator[str]:
    """Names policies that raised, and new episodes that contradict, before any answer."""
    for each in document.get("raised") or ():
        yield "\n".join(wrapped(f"Raised  {each['text']}.", width, rest=INDENT))
    for scope, each in document["contradictions"].items():
        text = f"Contradiction  {scope}: {each['why']}."
        yield "\n".join(wrapped(text, width, rest=INDENT))


def head_line(document: Mapping[str, Any], width: int) -> str:
    """The run, and the number of episodes that were played, now and by an earlier call."""
    again = document.get("reused") or 0
    also = f", {again:,} of an earlier call used again" if again else ""
    text = (
        f"Diagnosed  {document['run']}: {document['episodes']:,} new episodes{also} "
        f"({limit_words(document)}), from seed {document['seed']}."
    )
    return "\n".join(wrapped(text, width, rest=INDENT))


def limit_words(document: Mapping[str, Any]) -> str:
    """Limit of episodes, and the env steps that were taken where they were limited too."""
    most = f"limit: {document['most_episodes']:,}"
    if document.get("budget") is None:
        return most
    return f"{most}; {document['steps']:,} of {document['budget']:,} env steps"


def _answers(document: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The answers by name, the team's first."""
    team = {TEAM: document["team"]} if document["team"] is not None else {}
    return {**team, **document["agents"]}


def _scopes(document: Mapping[str, Any], width: int) -> Iterator[str]:
    """A block for each condition that was judged; scopes with the same block share it."""
    groups: dict[str, list[str]] = {}
    for scope in dict.fromkeys(each["scope"] for each in _answers(document).values()):
        groups.setdefault("\n".join(_scope(document, scope, width)), []).append(scope)
    for body, scopes in groups.items():
        title = few(scopes)
        yield f"{'Team' if title == TEAM else title}\n{body}"


def _of_scope(document: Mapping[str, Any], scope: str) -> Mapping[str, Any]:
    """The answer for a scope: one that names a cause, if any does."""
    mine = [each for each in _answers(document).values() if each["scope"] == scope]
    return next((each for each in mine if each["component"]), mine[0])


def _scope(document: Mapping[str, Any], scope: str, width: int) -> Iterator[str]:
    """Condition, number of failed episodes, answer, and effects of ideal substitutes."""
    found = _of_scope(document, scope)
    condition = document["conditions"].get(scope, document["conditions"].get(EACH, "?"))
    yield from item_lines(
        f"An episode counts as failed if {condition}, or if an exception ends it.", width
    )
    share, fresh = found["success"], document["fresh"].get(scope, {"failed": 0, "episodes": 0})
    recorded = document["recorded"].get(scope, {"failed": 0, "episodes": 0})
    named = ", ".join(f"{who} = {name}" for who, name in document["policies"].items())
    how = f"with {named} in place of the recorded policy" if named else "with nothing changed"
    text = (
        f"Failed: {recorded['failed']} of {recorded['episodes']} recorded episodes, and "
        f"{fresh['failed']} of {fresh['episodes']} new ones {how}. Success rate of the new ones: "
        f"{share['share']:.0%} (95 % interval {share['low']:.0%} to "
        f"{share['high']:.0%}), expected if nothing is wrong: {document['expected']:.0%} "
        "(--expected)."
    )
    yield from item_lines(text, width)
    yield from item_lines(f"{answer_sentence(found)}.", width)
    yield from _ideals(document, scope, width)


def answer_sentence(found: Mapping[str, Any]) -> str:
    """The answer with its reason, without a full stop: the cause, the causes, or none."""
    between = " or " if found["answer"] == "ambiguous" else " and "
    cause = between.join(found["labels"]) or found["component"]
    begin = {
        "healthy": "Healthy",
        "not_failing": "Not failing beyond chance",
        "isolated": f"The cause is {cause} (isolated)",
        "joint": f"The causes are {cause} together (joint)",
        "ambiguous": f"Possible causes: {cause} (ambiguous)",
        "environment": f"The cause is {cause}, no agent's own (environment)",
        "protocol": f"The cause is {cause}, how episodes are played and not an agent (protocol)",
        "elsewhere": "Another agent's",
        "unexplained": "Unexplained",
        "not_tried": "Not tried",
    }[found["answer"]]
    return f"{begin}: {found['why']}"


def _tested(document: Mapping[str, Any], *kinds: str, scope: str | None = None) -> list[Any]:
    """The interventions of some kinds that were played, each once."""
    return list(
        {
            each["intervention"]: each
            for found in _answers(document).values()
            if scope in (None, found["scope"])
            for each in found["tested"]
            if each["kind"] in kinds
        }.values()
    )


def _ideals(document: Mapping[str, Any], scope: str, width: int) -> Iterator[str]:
    ideals = _tested(document, "ideal", "swap", "undo", scope=scope)
    if not ideals:
        return
    ideals.sort(key=lambda each: not each.get("restores"))
    restores = any(each.get("restores") for each in ideals)
    text = (
        f"{_kinds(ideals)}, and the change of the success rate with its "
        "95 % interval, each alone; +1.00: from 0% to 100%."
    )
    if restores:
        text += (
            f" Restores: closes at least {document['part']:.0%} of the gap to "
            f"{document['expected']:.0%} success, beyond chance (p, corrected for all that were "
            "tried: Holm)."
        )
    yield from item_lines(text, width)
    rows = [[each["intervention"], effect_text(each), _ideal_word(each)] for each in ideals]
    yield from _rows(rows, width)


def _kinds(tested: Sequence[Mapping[str, Any]]) -> str:
    words = {
        "ideal": "ideal substitutes (one thing made ideal)",
        "swap": "policies that were swapped",
        "undo": "undos from outside (one thing done otherwise at an agent's boundary)",
    }
    kinds = {each["kind"] for each in tested}
    text = ", ".join(word for kind, word in words.items() if kind in kinds)
    return text[:1].upper() + text[1:]


def _responses(document: Mapping[str, Any], width: int) -> str:
    """The response tests, in sentences."""
    rows = document.get("responses") or {}
    texts = (f"{name}: {each['text']}" for name, each in rows.items())
    return items_text("Response tests", texts, width)


def _ideal_word(tested: Mapping[str, Any]) -> str:
    if not tested.get("restores"):
        return ""
    at = tested.get("flips_at")
    is_ideal = at is None or tested["intervention"].endswith((f"= {at:g}", f"= {float(at)}"))
    return "restores" if is_ideal else f"restores; a setting of {at:g} does too"


def _perturbations(document: Mapping[str, Any], width: int) -> str:
    played = _tested(document, "perturbation")
    if not played:
        return ""
    text = (
        "Perturbations (one thing disturbed or cut short), and the change of the team's mean "
        "return with its 95 % interval. They show what the return depends on, never a cause."
    )
    lines = wrapped(text, width, rest=INDENT)
    shown = [each for each in played if each.get("depends")]
    lines += _rows(
        [[e["intervention"], effect_text(e), _perturbation_word(e)] for e in shown], width
    )
    if len(played) > len(shown):
        rest = (
            f"{len(played) - len(shown)} {'others' if shown else 'played'}: no change beyond chance"
        )
        lines += item_lines(rest, width)
    return "\n".join(lines)


def _perturbation_word(tested: Mapping[str, Any]) -> str:
    word = "higher" if tested["effect"] > 0 else "lower"
    at = tested.get("flips_at")
    return word if at is None else f"{word}; most episodes fail from strength {at:g}"


def _rows(rows: list[list[str]], width: int) -> Iterator[str]:
    """A table, indented below its sentence; what doesn't fit its column is broken, never cut."""
    cells = [[one_line(cell) for cell in row] for row in rows]
    if cells:
        yield from (INDENT + line for line in column_lines(cells, width=width - len(INDENT)))


def effect_word(tested: Mapping[str, Any]) -> str:
    """The effect of an intervention: `restores`, `helps`, `hurts`, or empty."""
    if tested.get("restores"):
        return "restores"
    if tested.get("depends"):
        return "helps" if tested["effect"] > 0 else "hurts"
    return ""


def _agents(document: Mapping[str, Any], width: int) -> str:
    """The answer of each agent, beside that of the condition it is judged by."""
    groups: dict[str, list[str]] = {}
    for name, found in document["agents"].items():
        if found["scope"] == name:
            continue
        whole = _of_scope(document, found["scope"])
        is_same = all(found[key] == whole[key] for key in ("answer", "labels", "why"))
        scope = "the team" if found["scope"] == TEAM else found["scope"]
        text = f"as for {scope}" if is_same else answer_sentence(found)
        text = text[:1].lower() + text[1:]
        groups.setdefault(text, []).append(name)
    texts = (f"{', '.join(names)}: {text}." for text, names in groups.items())
    return items_text("Agents", texts, width)


def _not_tested(document: Mapping[str, Any], width: int) -> str:
    """Labels that weren't tested: what holds for all once, then what holds for some agents."""
    holders: dict[tuple[str, str], list[str]] = {}
    for name, found in _answers(document).items():
        for each in found["not_tested"]:
            holders.setdefault((each["label"], each["why"]), []).append(name)
    count = len(document["agents"])
    groups: dict[tuple[str, str], list[str]] = {}
    for (label, why), names in holders.items():
        is_all = TEAM in names or len(names) == count
        whom = "" if is_all else f" for {few(names)}"
        groups.setdefault((why, whom), []).append(label)
    texts = (f"{', '.join(labels)}{whom}: {why}" for (why, whom), labels in groups.items())
    return items_text("Causes that weren't tested", texts, width)


def _not_played(document: Mapping[str, Any], width: int) -> str:
    title = f"Not played ({limit_words(document)}; --episodes, --budget)"
    return items_text("\n".join(wrapped(title, width, rest=INDENT)), document["not_played"], width)


def _counterfactuals(rows: Sequence[Mapping[str, Any]], width: int) -> str:
    """Failed recorded episodes with one thing ideal: how they end, and their first difference."""
    if not rows:
        return ""
    title = "Counterfactuals: failed recorded episodes, played again with one thing made ideal"
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for each in rows:
        key = (each["intervention"], each["restored"], each["restored_open"])
        groups.setdefault(key, []).append(each)
    lines = wrapped(title, width, rest=INDENT)
    for (intervention, restored, restored_open), mine in groups.items():
        ends = "succeed" if restored else "still fail"
        also = "also " if restored == restored_open else ""
        other = "succeed" if restored_open else "still fail"
        text = (
            f"with {intervention}: recorded episodes {few(each['episode'] for each in mine)} "
            f"{ends}; they {also}{other} if all other agents repeat their recorded actions"
        )
        lines += item_lines(text, width)
        for each in mine:
            where = difference_place(each)
            where = f"first difference at {where}" if where else "no difference"
            lines += wrapped(
                f"episode {each['episode']}: {where}", width, first=INDENT * 2, rest=INDENT * 3
            )
    return "\n".join(lines)


def difference_place(counterfactual: Mapping[str, Any]) -> str:
    """Turn, field and agent of the first difference; empty where there is none."""
    if counterfactual["turn"] is None:
        return ""
    agent, field = counterfactual["agent"], counterfactual["field"]
    of_agent = "" if agent is None else f" of {agent}"
    return f"turn {counterfactual['turn']}, {FIELDS.get(field, field)}{of_agent}"


def restored_first(document: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The counterfactual to show: of the first restored episode, the one that differs last.

    The later it differs, the less of the episode an intervention changed.
    """
    found = [
        each
        for each in document.get("counterfactuals") or ()
        if each["restored"] and each["failed"] and each["turn"] is not None
    ]
    mine = [each for each in found if each["episode"] == found[0]["episode"]]
    return max(mine, key=lambda each: int(each["turn"]), default=None)


def acted_text(counterfactual: Mapping[str, Any]) -> str:
    """An agent's action in a failed episode, and in the same one restored; empty if not known."""
    did, instead = counterfactual.get("did"), counterfactual.get("instead")
    if did is None or instead is None:
        return ""
    turn, episode, agent = (counterfactual[key] for key in ("turn", "episode", "agent"))
    text = (
        f"turn {turn} of episode {episode}: {agent} does {did}; after "
        f"{counterfactual['intervention']} it does {instead}, and the episode succeeds"
    )
    if counterfactual.get("often"):
        often, was, restored = counterfactual["often"]
        text += f". {often} is {was:.0%} of its actions there, {restored:.0%} once restored"
    return text
