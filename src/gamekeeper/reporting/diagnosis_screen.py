"""A diagnosis on one screen: agent, first turn, repair, effect, and what to try next."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.reporting.diagnosis_text import (
    TEAM,
    acted_text,
    answer_sentence,
    contradiction_lines,
    difference_place,
    head_line,
    limit_words,
    restored_first,
)
from gamekeeper.reporting.results_text import few
from gamekeeper.reporting.text_columns import wrapped
from gamekeeper.statistics.significance import p_text

INDENT: Final = " " * 11
OFTEN: Final = 0.5
"""Part of its actions that a policy draws, from which that is worth a row."""
UNDOS: Final = 3
"""Changes that restore of which a screen has room, and one of each label."""
LEFT_OUT: Final = 3
"""Things that weren't tried of which a screen has room."""
OF_PIVOTS: Final = ("--contract", "--policy", "--allow-import")
"""Options that `gamekeeper pivots` has, too."""
MEMORY: Final = "memory"
"""Name of evidence that lies in no folder: no command could go on from it."""
CAUSES: Final = {
    "isolated": "this change alone restores success; no other is shown to, but for sets with it",
    "joint": "several changes together restore success, and none of them does alone",
    "ambiguous": "several changes restore success, or may: they can't be told apart",
    "environment": "what restores success is the same for all agents",
    "protocol": "what restores success is how episodes are played, or where they are cut off",
}
"""Answers that name a cause, and what each means."""
NOBODYS: Final = ("environment", "protocol")
"""Those of them that blame no agent."""


def diagnosis_screen(
    document: Mapping[str, Any], *, width: int, options: Mapping[str, Any] | None = None
) -> str:
    """The answer in a few rows, and the lines to paste next.

    Args:
        width: columns that no line exceeds, but for a command.
        options: of the command that gave it, by their names; the lines to paste keep them.
    """
    blocks = [*contradiction_lines(document, width), head_line(document, width)]
    rows = [*_fails(document), *_agents(document), *_first_turn(document), *_repairs(document)]
    rows += [*_others(document), *_noted(document), *_left_out(document)]
    lines = [
        line
        for title, text in rows
        for line in wrapped(text, width, first=f"{title:<11}", rest=INDENT)
    ]
    commands = _next(document, options or {})
    lines += [f"{'Next' if not k else '':<11}{each}" for k, each in enumerate(commands)]
    return "\n\n".join([*blocks, "\n".join(lines)])


def _named(document: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The agents of which a cause is named."""
    agents = document["agents"].items()
    return {name: each for name, each in agents if each["answer"] in CAUSES}


def _fails(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """A row of how many episodes fail, where no cause says it with its effect."""
    if document["team"] is None or not _is_failing(document):
        return
    recorded, fresh = (document[key].get(TEAM) for key in ("recorded", "fresh"))
    if recorded and fresh:
        yield (
            "Fails",
            f"{recorded['failed']} of {recorded['episodes']} recorded episodes, "
            f"{fresh['failed']} of {fresh['episodes']} new ones; expected: "
            f"{1 - document['expected']:.0%} at most (--expected)",
        )


def _agents(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Rows of the agents with a cause; agents with the same answer share one."""
    groups: dict[str, list[str]] = {}
    for name, each in _named(document).items():
        is_open = each["answer"] == "ambiguous"
        cause = (" or " if is_open else " and ").join(each["labels"])
        place = each["component"] or ""
        said = f"{cause}: {place}" if cause and cause not in place else place or cause
        text = f"({each['answer']}; {said})"
        if each["answer"] in NOBODYS:
            name, text = "none.", f"{answer_sentence(each)}."
        groups.setdefault(text, []).append(name)
    raised = [each["agent"] for each in document.get("raised") or ()]
    if not groups and raised:
        yield "Agent", f"{', '.join(raised)}: see what its policy raised, above"
    elif not groups:
        whole = document["team"] or next(iter(document["agents"].values()))
        yield "Agent", f"none. {answer_sentence(whole)}."
    for number, (text, names) in enumerate(groups.items()):
        if len(names) > 1:
            text = text.replace(f"{', '.join(names[:-1])} and {names[-1]}'s", "their")
        yield "" if number else "Agent", f"{', '.join(dict.fromkeys(names))} {text}"
    for answer in dict.fromkeys(each["answer"] for each in _named(document).values()):
        yield "", f"{answer}: {CAUSES[answer]}"


def _first_turn(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """A row of the first turn at which a failed episode differs from its restored one."""
    first = restored_first(document)
    if first is not None and acted_text(first):
        yield "When", f"{acted_text(first)}."
    elif first is not None:
        yield (
            "When",
            f"{difference_place(first)} in episode {first['episode']}: the first difference to "
            f"the same episode with {first['intervention']}",
        )


def _tested(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The tests that restore, of the least substitutes that are named; each once."""
    answers = [*_named(document).values(), *([document["team"]] if document["team"] else [])]
    names = {name for each in answers for name in each["substitutes"]}
    tests = [test for each in answers for test in each["tested"] if test.get("restores")]
    is_pair = document.get("differences") is not None
    found = {x["intervention"]: x for x in tests if is_pair or x["intervention"] in names}
    return list(found.values())


def _repairs(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Rows of the interventions that restore success, and their effect."""
    tests = _tested(document)
    firsts = {each["label"]: each for each in tests[::-1]}.values()  # of each label, the first
    shown = [each for each in tests if each in firsts]
    shown += [each for each in tests if each not in shown][: max(UNDOS - len(shown), 0)]
    for number, each in enumerate(shown):
        yield "" if number else "Repair", each["intervention"]
    if len(shown) < len(tests):
        yield "", f"and {len(tests) - len(shown)} more"
    beside = [name for each in _named(document).values() for name in each.get("beside", ())]
    for number, name in enumerate(dict.fromkeys(beside)):
        yield "" if number else "Also", name
    if tests:
        best = max(tests, key=lambda each: float(each["effect"]))
        whose = f"{best['intervention']}: " if len(tests) > 1 else ""
        yield (
            "Effect",
            f"{whose}{_change(document, best)} (95 % interval {best['low']:+.2f} to "
            f"{best['high']:+.2f}), {p_text(best['p'])}, {best['n']} new episodes with it and the "
            "same without",
        )


def _change(document: Mapping[str, Any], best: Mapping[str, Any]) -> str:
    """The change that a test made, and from what to what where the share as it is is known."""
    effect = float(best["effect"])
    if best.get("measure") != "success":
        return f"mean return {effect:+.2f}"
    answers = [*_named(document).values(), *([document["team"]] if document["team"] else [])]
    known = [each.get("success") for each in answers if best in each["tested"]]
    share = known[0]["share"] if known and known[0] else None
    span = "" if share is None else f"from {share:.0%} to {share + effect:.0%}, "
    return f"success rate {span}{effect:+.2f}"


def _others(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    named = _named(document)
    others = [name for name in document["agents"] if name not in named]
    if named and others:
        yield "Others", f"{few(others)}: no cause found in what was tried"


def _noted(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Rows of what is striking about policies, where no agent alone is named: facts, no causes."""
    if any(each["answer"] in ("isolated", "joint") for each in _named(document).values()):
        return
    found = [
        f"{name} {each['text']}"
        for name, each in (document.get("responses") or {}).items()
        if (each["changes"] and not each["reactions"])
        or each["lag"]
        or each["randomness"] > OFTEN
        or not each["is_repeatable"]
    ]
    for number, text in enumerate(found):
        yield "" if number else "Noted", text


def _left_out(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """A row of what neither the episodes nor the budget reached."""
    rows = document["not_played"]
    if rows:
        more = f"; and {len(rows) - LEFT_OUT} more" if len(rows) > LEFT_OUT else ""
        yield "Not tried", f"{'; '.join(rows[:LEFT_OUT])}{more} ({limit_words(document)})"


def _is_failing(document: Mapping[str, Any]) -> bool:
    """Somebody fails beyond chance, and no cause is named."""
    answers = {each["answer"] for each in document["agents"].values()}
    return not _named(document) and bool(answers & {"unexplained", "not_tried"})


def _words(options: Mapping[str, Any]) -> str:
    """Options as they are typed; those without a value are left out."""
    found = []
    for name, value in options.items():
        values = value if isinstance(value, list) else [value]
        found += [
            f" {name}" if each is True else f" {name} {shlex.quote(str(each))}"
            for each in values
            if each is not None and each is not False
        ]
    return "".join(found)


def _next(document: Mapping[str, Any], options: Mapping[str, Any]) -> Sequence[str]:
    """Command lines that go on from here; none where no folder holds the run."""
    if document["run"] == MEMORY:
        return ()
    run = shlex.quote(document["run"])
    condition = document["conditions"].get(TEAM)
    words = "" if condition is None else f" --failed {shlex.quote(condition)}"
    good = document.get("differences")
    of_pivots = words + _words({name: options.get(name) for name in OF_PIVOTS})
    words += _words(options)
    found = []
    if _named(document) and document["counterfactuals"]:
        episode = document["counterfactuals"][0]["episode"]
        is_lost = all(each["failed"] == each["episodes"] for each in document["fresh"].values())
        end = "a turn that saves it" if is_lost else "the turn that lost it"
        found.append(f"gamekeeper pivots {run} --episode {episode}{of_pivots}   # {end}")
    elif good is None and _is_failing(document) and not document.get("raised"):
        found.append(f"gamekeeper diagnose {run} --good GOOD_RUN{words}   # beside one that works")
        if not options.get("--try"):
            end = "--try AGENT=POLICY   # another policy in an agent's place"
            found.append(f"gamekeeper diagnose {run}{words} {end}")
    if document["not_played"]:
        more = f" --episodes {2 * document['most_episodes']}"
        if document.get("budget") is not None:
            more += f" --budget {2 * document['budget']}"
        found.append(f"gamekeeper diagnose {run}{words}{more}   # tries the rest")
    beside = "" if good is None else f" --good {shlex.quote(good['good'])}"
    found.append(f"gamekeeper diagnose {run}{beside}{words} --all   # shows every test")
    return found
