"""First screen of a page: the questions that a reader has first, each answered in a sentence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, TypedDict

import numpy as np

from gamekeeper.checks.verdict import SEVERITIES
from gamekeeper.reporting.audit_text import broken_rule
from gamekeeper.reporting.diagnosis_screen import CAUSES
from gamekeeper.reporting.diagnosis_text import acted_text, answer_sentence, restored_first
from gamekeeper.reporting.page.audit_sections import failed_words
from gamekeeper.reporting.page.episode_figures import UNFINISHED, failed_text
from gamekeeper.reporting.page.page_data import Answer, PageBlock, shown
from gamekeeper.reporting.page.page_html import env_words, quoted
from gamekeeper.reporting.page.pivots_section import pivot_marks
from gamekeeper.reporting.pivots_text import kept_by, no_pivot_text
from gamekeeper.reporting.results_text import few, last_line
from gamekeeper.statistics.interval import FloatArray

if TYPE_CHECKING:
    from gamekeeper.reporting.page.composition import Documents, ShownRun

Document = Mapping[str, Any]

STATES: Final = {"finalized": "passed", "recovered": "warn", "open": "warn", "failed": "failed"}
"""Style of a run's status."""
MOST_UNFINISHED: Final = 3
"""Most unfinished episodes that a sentence names."""
MOST_BROKEN: Final = 3
"""Most broken rules that the first screen names."""


class Link(TypedDict, total=False):
    """Address and words of an answer's link."""

    link: str
    link_text: str


NAMED: Final = ("isolated", "joint", "ambiguous")
"""Answers of a diagnosis that name agents."""
NO_AGENTS: Final = ("environment", "protocol")
"""Answers of a diagnosis that name a cause which is no agent's own."""
DIGITS: Final = 12
"""Characters of a digest that a sentence shows."""


def answers_of(run: ShownRun, documents: Documents) -> tuple[Answer, ...]:
    """The answers that are known; what was not asked is left to `not_asked`."""
    found = (
        *_state(run),
        _outcome(run),
        _least(run, documents.attribution) or _lowest(run),
        _cause(run, documents.diagnosis),
        _did(run, documents.diagnosis),
        _lost(run, documents),
        _otherwise(documents),
        _findings(documents.audit),
        _compared(documents.evaluation),
        _again(run),
    )
    return tuple(each for each in found if each is not None)


def _state(run: ShownRun) -> Iterator[Answer]:
    """State of a recording, and its files; in one sentence where both are as they should be."""
    status, text = run.card.status, " ".join(state_texts(run))
    if status == "finalized" and not text and run.evidence.root is not None:
        yield replace(_verified(run), question="State", word=status)
        return
    badge, cut = STATES.get(status, "passed"), _cut(run)
    if cut:
        word, badge = ("failed", "failed") if cut[0].get("error") else (status, "warn")
        yield Answer("State", text, word, badge, **_last_turn(run, cut[0]))
    elif text or badge != "passed":
        yield Answer("State", text or "The run is complete.", status, badge)
    yield _verified(run)


def state_texts(run: ShownRun) -> Iterator[str]:
    """Sentences about a run that is incomplete, and the command that finalizes an open one."""
    if run.evidence.not_whole:
        yield run.evidence.not_whole
    if run.card.status == "open":
        yield f"If it was killed: `gamekeeper recover {quoted(run.path)}`."
    cut = [f"episode {header['episode']} {_stopped(run, header)}" for header in _cut(run)]
    if cut:
        text = few(cut, most=MOST_UNFINISHED)
        yield f"{text[0].upper()}{text[1:]}."


def _cut(run: ShownRun) -> list[Mapping[str, Any]]:
    """Headers of episodes that raised or are unfinished; those that raised come first."""
    headers = run.figures.headers
    raised = [header for header in headers if header.get("error")]
    unfinished = [header for header in headers if header.get("end") in UNFINISHED]
    return [*raised, *(header for header in unfinished if not header.get("error"))]


def _stopped(run: ShownRun, header: Mapping[str, Any]) -> str:
    """The reason why an episode is unfinished."""
    if header.get("error"):
        return f"ended with an error: {last_line(header['error'])}"
    return f"is unfinished: its recording stopped after {run.evidence.turns_of(header)} steps"


def _verified(run: ShownRun) -> Answer:
    """Files against their checksums; a page never replays."""
    root = run.evidence.root
    link: Link = {"link": "#provenance", "link_text": "provenance"}
    if root is None:
        text = "A run that isn't finalized has no checksums to compare."
        return Answer("Evidence", text, "not compared", "warn", **link)
    text = f"Every file matches its checksum (root digest {root[:DIGITS]})"
    if run.evidence.manifest.get("expanded"):
        text += "; recorded small, and played again in full"
    return Answer("Evidence", f"{text}. This page replayed nothing.", "intact", "passed", **link)


def _outcome(run: ShownRun) -> Answer | None:
    """Episodes that failed by the contract's condition, else what the team was paid."""
    if all(each is None for each in run.failed):
        return _paid(run)
    bad = [k for k, each in enumerate(run.failed) if each]
    text = f"{failed_text(run.failed)} (failed if {run.condition}).{_team_range(run)}"
    if not bad:
        return Answer("Outcome", text, "passed", "passed")
    return Answer(
        "Outcome", text, "failed", "failed", **_last_turn(run, run.figures.headers[bad[0]])
    )


def _team_range(run: ShownRun) -> str:
    """A sentence on the lowest and the highest of the team's returns, where they differ."""
    low, high = (f(run.figures.team) if len(run.figures.team) else 0.0 for f in (np.min, np.max))
    if not np.isfinite([low, high]).all() or shown(low) == shown(high):
        return ""
    return f" Return of all agents together: {shown(low)} to {shown(high)}."


def _paid(run: ShownRun) -> Answer | None:
    """The range of the team's returns, where no condition says which of them is a failure."""
    team = run.figures.team
    if not len(team) or not np.isfinite(team).all():
        return None
    low, high = shown(float(team.min())), shown(float(team.max()))
    returns = f"between {low} and {high}"
    if low == high:
        returns = f"{low} in every episode{_winner(run)}"
    text = f"No condition of failure is declared. Return of all agents together: {returns}."
    header = run.figures.headers[int(np.argmin(team))]
    link = _last_turn(run, header) | {"link_text": _lowest_text("the lowest", header, team)}
    return Answer("Outcome", text, "not judged", "not_tested", **link)


def _lowest_text(words: str, header: Mapping[str, Any], values: FloatArray) -> str:
    """Words of a link to the first episode with the lowest value; equal ones aren't the lowest."""
    number, alike = header["episode"], int(np.isclose(values, values.min()).sum())
    if alike < len(values):
        return f"{words}, episode {number}{_tied(alike - 1)}"
    return f"episode {number} (all {alike} equal)" if alike > 1 else f"episode {number}"


def _tied(others: int) -> str:
    return f" (tied with {others} other{'' if others == 1 else 's'})" if others else ""


def _winner(run: ShownRun) -> str:
    """The agent that most often has the highest return alone, as the rest of a sentence."""
    if len(run.figures.agents) < 2:
        return ""
    values = np.where(run.figures.present, run.figures.returns, -np.inf)
    is_best = values == values.max(axis=1, keepdims=True)
    counts = is_best[is_best.sum(axis=1) == 1].sum(axis=0)
    if not counts.any():
        return ""
    agent = run.figures.agents[int(np.argmax(counts))]
    return f"; {agent} has the highest in {counts.max()} of {len(values)}"


def _last_turn(run: ShownRun, header: Mapping[str, Any]) -> Link:
    """A link to an episode's last turn."""
    number, turns = header["episode"], run.evidence.turns_of(header)
    return {
        "link": f"#play:{run.key}/{number}/{turns}",
        "link_text": f"end of episode {number}, after {turns} steps",
    }


def _least(run: ShownRun, attribution: Document | None) -> Answer | None:
    """The agent that adds least by an attribution; None where it wasn't asked."""
    found = _least_added(attribution)
    if found is None:
        return None
    agent, text = found
    place = run.figures.agents.index(agent) if agent in run.figures.agents else None
    link = {} if place is None else _worst_episode(run, place)
    return Answer("Adds least", text, agent, "plain", **link)


def _lowest(run: ShownRun) -> Answer | None:
    """The agent with the lowest mean return; None where all are equal, or one isn't a number."""
    figures, means = run.figures, []
    for place in range(len(figures.agents)):
        values = figures.returns[figures.present[:, place], place]
        means.append(float(values.mean()) if len(values) else np.nan)
    if len(means) < 2 or not np.isfinite(means).all() or np.allclose(means, means[0]):
        return None
    place = int(np.argmin(means))
    others = np.delete(means, place)
    low, high = shown(float(others.min())), shown(float(others.max()))
    text = (
        f"Mean return {shown(means[place])}; of the {'other' if len(others) == 1 else 'others'} "
        f"{low if low == high else f'{low} to {high}'}. A return alone shows no fault."
    )
    return Answer(
        "Lowest return", text, figures.agents[place], "plain", **_worst_episode(run, place)
    )


def _least_added(attribution: Document | None) -> tuple[str, str] | None:
    known = {
        agent: part["difference"]
        for agent, part in ((attribution or {}).get("agents") or {}).items()
        if part.get("difference") and part["difference"].get("value") is not None
    }
    if not known:
        return None
    values = [float(part["value"]) for part in known.values()]
    agent = list(known)[int(np.argmin(values))]
    part, others = known[agent], int(np.isclose(values, min(values)).sum()) - 1
    sign, word = (-1, "higher") if part["value"] < 0 else (1, "lower")
    between = " (too few episodes for an interval)"
    if part.get("low") is not None:
        low, high = sorted((sign * part["low"], sign * part["high"]))
        between = f" (95 % interval {shown(low)} to {shown(high)})"
    text = f"With {part.get('baseline') or 'a baseline'} in its place the team's return is "
    return agent, f"{text}{shown(sign * part['value'])} {word}{between}{_tied(others)}."


def _worst_episode(run: ShownRun, place: int) -> Link:
    """A link to the agent's episode with its lowest return."""
    figures = run.figures
    played = np.flatnonzero(figures.present[:, place])
    values = figures.returns[played, place]
    header = figures.headers[int(played[np.argmin(values)])]
    text = _lowest_text("its lowest return", header, values)
    return {"link": f"#play:{run.key}/{header['episode']}/0", "link_text": text}


def _named(diagnosis: Document | None) -> dict[str, Document]:
    """The agents for which a cause is named, or the team where there is no such agent."""
    told = diagnosis or {"agents": {}}
    agents = {agent: each for agent, each in told["agents"].items() if each["answer"] in NAMED}
    team = told.get("team")
    return agents or ({"team": team} if team and team["answer"] in NAMED else {})


def _cause(run: ShownRun, diagnosis: Document | None) -> Answer | None:
    """The diagnosis' causes with its first restored counterfactual; None without a diagnosis."""
    if diagnosis is None:
        return None
    named = _named(diagnosis)
    every = [*filter(None, [diagnosis.get("team")]), *diagnosis["agents"].values()]
    outside = [each for each in every if each["answer"] in NO_AGENTS]
    if not named and outside:
        badge = str(outside[0]["answer"])
        text = f"{answer_sentence(outside[0])}."
        return Answer("Likely cause", text, badge, "failed", "#causes", "what was tested")
    if not named:
        answers = few(dict.fromkeys(str(each["answer"]).replace("_", " ") for each in every))
        return Answer("Likely cause", f"None was named: {answers}.", "none named", link="#causes")
    texts = [_named_cause(agent, each) for agent, each in named.items()]
    how = few(f"{each}: {CAUSES[each]}" for each in {str(x["answer"]): 0 for x in named.values()})
    link: Link = {"link": "#causes", "link_text": "what was tested"}
    each = restored_first(diagnosis)
    if each is not None:
        place = f"{run.key}/{each['episode']}/{each['turn']}"
        text = f"first difference: turn {each['turn']} of episode {each['episode']}"
        link = {"link": f"#play:{place}", "link_text": text}
    text = f"{few(texts, most=3)} ({how})."
    if not text.startswith(tuple(named)):
        text = f"{text[0].upper()}{text[1:]}"
    return Answer("Likely cause", text, few(named, most=3), "failed", **link)


def _did(run: ShownRun, diagnosis: Document | None) -> Answer | None:
    """An agent's action in a failed episode and in the same one restored, if it is known."""
    each = restored_first(diagnosis or {})
    text = acted_text(each or {})
    if each is None or not text:
        return None
    link = f"#play:{run.key}/{each['episode']}/{each['turn']}@{each['agent']}"
    text = f"{text[0].upper()}{text[1:]}."
    return Answer("First difference", text, link=link, link_text="watch it")


def _otherwise(documents: Documents) -> Answer | None:
    """Differences that something else would have made; None where none was tested."""
    first = restored_first(documents.diagnosis or {}) or {}
    text = _restored(_named(documents.diagnosis), first.get("intervention"))
    if text:
        link: Link = {"link": "#causes", "link_text": "what was tested"}
        return Answer("Counterfactual", text, "tested", "tested", **link)
    text = _held_still(documents.audit)
    if not text:
        return None
    return Answer("Counterfactual", text, "tested", "tested", "#verdicts", "verdicts")


def _restored(named: Mapping[str, Document], first: str | None) -> str:
    """The share of successes with and without an intervention that restores it."""
    for each in named.values():
        for tested in sorted(each["tested"], key=lambda test: test["intervention"] != first):
            if tested.get("restores") and tested.get("measure", "success") == "success":
                before = each["success"]["share"]
                after = min(max(before + tested["effect"], 0.0), 1.0)
                return (
                    f"After {tested['intervention']}, {after:.0%} of {tested['n']} new episodes "
                    f"succeed; unchanged, {before:.0%}{_interval(tested)}."
                )
    return ""


def _interval(tested: Document) -> str:
    """The interval of an effect on the share of successes, where there is one."""
    if tested.get("low") is None or tested.get("high") is None:
        return ""
    low, high = (f"{100 * tested[side]:+.0f}" for side in ("low", "high"))
    return f" (95 % interval of the difference: {low} to {high} points)"


def _held_still(audit: Document | None) -> str:
    """The failed checks that pass once the cause of another one is held still."""
    verdicts = (audit or {}).get("verdicts") or ()
    causes = [each for each in verdicts if each["outcome"] == "failed" and each.get("follows_from")]
    texts = [
        f"{each['id']} passes with {each['follows_from']['held_still']} "
        f"(it follows from {each['follows_from']['id']})"
        for each in causes
    ]
    return f"{'; '.join(texts)}." if texts else ""


def _lost(run: ShownRun, documents: Documents) -> Answer | None:
    """The first turn that lost an episode, else why none is named; None where none was sought."""
    episodes = (documents.pivots or {}).get("episodes") or ()
    if not episodes:
        return None
    each = next((each for each in episodes if each["pivots"]), episodes[0])
    number = each["episode"]
    if not each["pivots"]:
        text = f"No turn of episode {number} is named: {no_pivot_text(each)}."
        return Answer("Lost at", text, link="#pivots", link_text="curve of success")
    pivot, mark = each["pivots"][0], pivot_marks(each)[0]
    text = "; ".join([f"Episode {number}: {mark.text}", *list(kept_by(pivot))[:1]])
    link: Link = {"link": f"#play:{run.key}/{number}/{mark.turn}", "link_text": "watch it"}
    return Answer("Lost at", f"{text}.", f"turn {mark.turn}", "failed", **link)


def _named_cause(agent: str, each: Document) -> str:
    component = str(each["component"] or "the whole policy")
    cause = component if each["answer"] == "ambiguous" else " and ".join(each["labels"])
    cause = cause or component
    return cause if agent in cause else f"{cause} of {agent}"


def _findings(audit: Document | None) -> Answer | None:
    """Failed checks, and those among them that don't follow from another."""
    if audit is None:
        return None
    link: Link = {"link": "#verdicts", "link_text": "verdicts"}
    bad = [each for each in audit["verdicts"] if each.get("outcome") == "failed"]
    if not bad:
        counts = Counter(each.get("outcome") for each in audit["verdicts"])
        text = f"{_checks(counts['passed'])} passed; {counts['not_exercised']} not exercised."
        return Answer("Findings", text, "0 failed", "passed", **link)
    causes = [each for each in bad if not each.get("follows_from")]
    causes.sort(key=lambda each: SEVERITIES.index(each["severity"]))
    more = len(causes) - MOST_BROKEN
    words = failed_words(bad).removeprefix(f"{len(bad)} failed: ")
    text = f"{_checks(len(bad))} of the environment failed"
    tried = [each["reproduced"] for each in causes if each.get("reproduced")]
    if tried and all(each["failed"] == each["tried"] for each in tried):
        text += ", confirmed in every new process"
    lines = [*map(_broken, causes[:MOST_BROKEN]), *([f"and {more} more"] if more > 0 else [])]
    return Answer("Findings", f"{text}.", words, "failed", lines=tuple(lines), **link)


def _broken(verdict: Document) -> str:
    """The rule that was broken, worded as the command line does, and where first."""
    place = str((verdict.get("findings") or [{}])[0].get("where", ""))
    rule = broken_rule(verdict).rstrip(".")
    return f"{verdict['id']}  {rule}.{f' First failed at {place}' if place else ''}"


def _compared(evaluation: Document | None) -> Answer | None:
    """The first of an evaluation's supported claims; None without an evaluation."""
    if evaluation is None:
        return None
    claims = [str(each).rstrip(".") for each in evaluation.get("claims") or ()]
    refused = len(evaluation.get("refused") or ())
    link: Link = {"link": "#evaluation", "link_text": "all claims"}
    first = f"{claims[0]}." if claims else "No comparison supports a claim."
    more = f" {len(claims) - 1} more." if len(claims) > 1 else ""
    kept_back = f" {refused} refused." if refused else ""
    word = f"{len(claims)} claim{'' if len(claims) == 1 else 's'}"
    return Answer("Evaluation", f"{first}{more}{kept_back}", word, "plain", **link)


def _again(run: ShownRun) -> Answer | None:
    """The command that plays the run again; None of a run that has no end yet."""
    if run.evidence.root is None:
        return None
    env = "" if env_words(run.evidence) else " --env module:factory"
    text = f"`gamekeeper replay {quoted(run.path)}{env}` plays every episode again and compares it."
    return Answer("Run again", text, link="#provenance", link_text="all commands")


def _checks(count: int) -> str:
    return f"{count} check{'' if count == 1 else 's'}"


def not_asked(
    run: ShownRun, documents: Documents, *, env: str, plays_on: bool = False
) -> PageBlock | None:
    """One closed line for the documents that are missing, with the commands to copy.

    Args:
        env: the environment as commands name it, quoted; `ENV` where it can't be named.
        plays_on: the page itself plays on.
    """
    path = quoted(run.path)
    asked = dict(_commands(path, env, _failed_option(run), has_failed=any(run.failed)))
    missing = [name for name in asked if getattr(documents, name) is None]
    is_playable = run.evidence.root is not None and env_words(run.evidence) is not None
    if is_playable and not plays_on:
        asked["playing on"] = f"gamekeeper view {path} --interactive   # from any turn, changed"
        missing.append("playing on")
    if not missing:
        return None
    return PageBlock(
        title=f"Not part of this page, with commands: {', '.join(missing)}",
        snippets=(("Commands", "\n".join(asked[name] for name in missing)),),
        folded=True,
        anchor="not-asked",
    )


def _failed_option(run: ShownRun) -> str:
    """The option that says when an episode failed; empty where the contract says it."""
    if run.asked:
        return f" --failed {quoted(run.asked)}"
    if any(each is not None for each in run.failed) or not len(run.figures.team):
        return ""
    return f" --failed 'return < {np.median(run.figures.team):.4g}'"


def _commands(path: str, env: str, failed: str, *, has_failed: bool) -> Iterator[tuple[str, str]]:
    yield "diagnosis", f"gamekeeper diagnose {path}{failed}"
    if has_failed:
        yield (
            "pivots",
            f"gamekeeper pivots {path}{failed} --json > pivots.json; "
            f"gamekeeper report {path} --pivots pivots.json",
        )
    yield "attribution", f"gamekeeper attribute {path}"
    yield (
        "audit",
        f"gamekeeper audit {env} --json > audit.json; gamekeeper report {path} --audit audit.json",
    )
    yield (
        "evaluation",
        f"gamekeeper evaluate ... --out FOLDER; gamekeeper report {path} --evaluation FOLDER",
    )
