"""A whole page: what it says, what it offers, and that nothing in it comes to life."""

import contextlib
import hashlib
import json
import re
import zlib
from base64 import b64decode, b64encode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.labels import label
from gamekeeper.errors import EnvError, EvidenceError, RunError
from gamekeeper.reporting.page.answers import answers_of, not_asked
from gamekeeper.reporting.page.audit_sections import form_of_run
from gamekeeper.reporting.page.composition import Documents, continues, shown
from gamekeeper.reporting.page.episode_figures import figures_of
from gamekeeper.reporting.page.page_data import Page
from gamekeeper.reporting.page.page_html import render
from gamekeeper.runs.files.notes import annotate
from gamekeeper.viewing.report_file import opened, report
from tests.reporting.page import documents
from tests.reporting.page.games import PLAIN, Told, recorded
from tests.reporting.page.pages import Read, data_of

WORD = "word"
IMAGE = "<img src=x onerror='alert(2)'>"
HOSTILE = f"</script><script>alert(1)</script>{IMAGE}\"'`&lt;\u2028{{{{7*7}}}}\u202eevil"
NAMES = ("<b>\u202e_0", "\"'></td><script>x</script>_1")


def everything(folder: Path, word: str, agents: tuple[str, str]) -> str:
    """A page with all sections filled, two runs, labels and an error."""
    recorded(folder / "one", agents=agents, word=word, failure="gain < 6")
    with contextlib.suppress(EnvError):
        recorded(folder / "two", agents=agents, word=word, raises_at=4)
    label(folder / "one", "planning", agent=agents[0], episode=1, turn=2, why=word, by=word)
    out = report(
        folder / "one",
        folder / "page.html",
        others=[folder / "two"],
        title=word,
        audit=documents.audit(word, agents),
        diagnosis=documents.diagnosis(word, agents),
        attribution=documents.attribution(word, agents),
        evaluation=documents.evaluation(word, agents),
    )
    return out.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A page of harmless words."""
    return everything(tmp_path_factory.mktemp("plain"), WORD, PLAIN)


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The same page of hostile ones."""
    return everything(tmp_path_factory.mktemp("hostile"), HOSTILE, NAMES)


def test_hostile_words_make_no_element(plain: str, hostile: str) -> None:
    """Elements and attributes are those of the same page with harmless words, one for one.

    But for what is set apart as a name or as code, which backquotes in a sentence do.
    """
    pages = [Read(plain).elements, Read(hostile).elements]
    for tag in ("bdi", "code"):
        assert pages[0].pop((tag, ())) <= pages[1].pop((tag, ()))
    assert pages[0] == pages[1]


def test_hostile_words_are_shown_as_text(hostile: str) -> None:
    """A reader sees the very signs, in names, findings, labels and errors alike."""
    text = Read(hostile).text
    assert text.count(IMAGE) > 20
    assert NAMES[0] in text
    assert "{{7*7}}" in text


def test_words_that_turn_the_direction_stay_by_themselves(hostile: str) -> None:
    """Signs that turn the direction stand where it is kept apart, or in a block of their own."""
    own = {"bdi", "title", "figcaption", "caption", "summary"}
    loose = [path for path, text in Read(hostile).texts if "\u202e" in text and not own & set(path)]
    assert [path for path in loose if path[-1] not in ("td", "th", "script")] == []


def test_data_hold_no_markup(hostile: str) -> None:
    """JSON in the page has no sign that ends a script, and reads back to the very words."""
    start = hostile.index('id="gk-data">') + len('id="gk-data">')
    text = hostile[start : hostile.index("</script>", start)]
    assert not set(text) & set("<>&\u2028\u2029")
    assert data_of(hostile)["title"] == HOSTILE
    assert set(NAMES) == set(data_of(hostile)["episodes"][0]["returns"])


def test_policy_names_every_script_and_style(plain: str) -> None:
    """The policy holds the hashes of the page's one script and style, and allows no request."""
    read = Read(plain)
    policy = next(value for tag, name, value in read.attributes if "default-src" in value)
    assert "default-src 'none'" in policy
    assert "connect-src 'none'" in policy
    for tag in ("script", "style"):
        (body,) = re.findall(rf"<{tag}>(.*?)</{tag}>", plain, re.DOTALL)
        digest = b64encode(hashlib.sha256(body.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy


def test_page_asks_for_nothing(plain: str) -> None:
    """No attribute names another place; there are no handlers and no styles on elements."""
    for tag, name, value in Read(plain).attributes:
        assert not name.startswith("on"), (tag, name)
        assert name != "style"
        if name in ("src", "href"):
            assert value.startswith(("#", "data:")), (tag, name, value)


def test_ids_are_unique_and_links_lead_somewhere(plain: str) -> None:
    """Every address on the page exists once."""
    read = Read(plain)
    ids = [value for _, name, value in read.attributes if name == "id"]
    assert sorted(set(ids)) == sorted(ids)
    for _, name, value in read.attributes:
        if name in ("aria-labelledby", "data-copy"):
            assert value in ids
        if name == "href" and value.startswith("#") and not value.startswith("#play:"):
            assert value[1:] in ids


def test_page_says_what_is_known(plain: str) -> None:
    """Every section shows its document: verdicts by severity, causes, parts, cross-play."""
    text = " ".join(Read(plain).text.split())
    assert text.index("GK402") < text.index("GK101")
    for expected in (
        "2 failed",
        "1 not exercised",
        "Influence on the observation",
        "isolated",
        "restores",
        "Not known if lazy: one_0: word.",
        "Effects on the share of successes",
        "Effects on the team's return",
        "one_1 is lazy",
        "Shapley",
        "Penalties caused by another agent",
        "Cross-play in word",
        "Best responses",
        "gamekeeper verify",
        "Failure labels",
        "Errors",
        "two compared with one",
    ):
        assert expected in text, expected


def test_episodes_are_packed_and_offered(plain: str) -> None:
    """Each packed episode inflates to what the list says of it; pairs are of packed ones."""
    data = data_of(plain)
    for entry in data["episodes"]:
        assert entry["packed"]
        body = re.search(
            rf'id="gk-episode-{entry["run"]}-{entry["episode"]}">([^<]*)</script>', plain
        )
        assert body is not None
        packed = json.loads(zlib.decompress(b64decode(body[1]), -zlib.MAX_WBITS))
        assert (entry["run"], entry["episode"]) == (packed["run"], packed["episode"])
        assert entry["turns"] == packed["turns"]
    assert {"a", "b"} == {run["key"] for run in data["runs"]}
    assert list({(p["left"]["run"], p["right"]["run"]) for p in data["pairs"]}) == [("a", "b")]
    assert all(isinstance(pair["divergence"]["turn"], int) for pair in data["pairs"])
    first = data["episodes"][0]
    assert "label" in first["why"] or "failing" in first["why"]


def test_charts_are_those_that_script_draws(plain: str) -> None:
    """Every place for a chart has its data."""
    places = {value for _, name, value in Read(plain).attributes if name == "data-chart"}
    assert places == set(data_of(plain)["charts"])
    assert "returns-a" in places


def test_small_budget_leaves_episodes_out_and_says_so(tmp_path: Path) -> None:
    """Named episodes are there whatever the budget; the page tells what isn't."""
    recorded(tmp_path / "run", episodes=6)
    page = report(tmp_path / "run", tmp_path / "page.html", budget_bytes=0, episodes=[4])
    text = page.read_text(encoding="utf-8")
    assert [entry["episode"] for entry in data_of(text)["episodes"] if entry["packed"]] == [4]
    assert len(data_of(text)["episodes"]) == 6
    assert "1 of 6 episodes are on this page" in " ".join(Read(text).text.split())


def test_page_of_a_bare_run_says_what_is_missing(tmp_path: Path) -> None:
    """Without documents one line names the commands that make them; laziness isn't guessed."""
    run = recorded(tmp_path / "run") and tmp_path / "run"
    page = report(run, tmp_path / "p.html").read_text()
    text = " ".join(Read(page).text.split())
    assert "Not part of this page, with commands: diagnosis, attribution, audit, evaluation" in text
    for command in (f"diagnose {run}", f"attribute {run}", "audit ", "evaluate ..."):
        assert f"gamekeeper {command}" in text
    assert text.count("gamekeeper diagnose") == 1
    ids = [value for tag, name, value in Read(page).attributes if (tag, name) == ("section", "id")]
    assert ids == ["player", "agents", "form", "provenance"]
    assert "Lazy agents are found by replacing them" in text
    assert "not tested" not in text


def test_page_of_one_agent_and_an_object_in_memory(tmp_path: Path) -> None:
    """One agent's returns are compared with none, and a replay is asked to name an environment."""

    class Here(Told):
        """No module has it under its name."""

    evidence = gk.rollout(Here(("alone",)), episodes=1, out=tmp_path / "run")
    text = " ".join(Read(report(tmp_path / "run", tmp_path / "p.html").read_text()).text.split())
    assert "(parallel), 1 agent," in text
    assert "1 agent in an episode" in text
    assert "differ by agent" not in text
    assert f"gamekeeper replay {tmp_path / 'run'} --env module:factory plays" in text
    assert form_of_run(evidence, figures_of(evidence))["reward"] is None


def test_documents_are_found_in_the_run(tmp_path: Path) -> None:
    """The last diagnosis and attribution among the annotations are shown."""
    recorded(tmp_path / "run")
    for word in ("old", "new"):
        told = documents.diagnosis(word, PLAIN)
        annotate(tmp_path / "run", {"kind": "diagnosis", "diagnosis": told})
    annotate(
        tmp_path / "run", {"kind": "attribution", "document": documents.attribution("w", PLAIN)}
    )
    text = Read(report(tmp_path / "run", tmp_path / "p.html").read_text()).text
    assert "one_1 is lazy" in text
    assert "new" in text
    assert "old" not in text.split()


def test_frames_are_shown(tmp_path: Path) -> None:
    """Recorded pictures are in the episode, thinned out where they don't fit."""
    gk.rollout("handover", episodes=2, out=tmp_path / "run", frames=True)
    for frames_bytes, is_whole in ((8_000_000, True), (60_000, False)):
        page = report(tmp_path / "run", tmp_path / "p.html", frames_bytes=frames_bytes).read_text()
        body = re.search(r'id="gk-episode-a-0">([^<]*)</script>', page)
        assert body is not None
        packed = json.loads(zlib.decompress(b64decode(body[1]), -zlib.MAX_WBITS))
        assert packed["drawing"]["kind"] == "frames"
        assert (len(packed["drawing"]["at"]) > packed["turns"]) is is_whole


@pytest.mark.parametrize(("policies", "goes_on"), [("random", True), ("first-legal", False)])
def test_learning_goes_on_in_runs_of_the_same_policies_alone(policies: str, goes_on: bool) -> None:
    """A run of another policy is another experiment, no learning."""
    one, two = (
        shown(recorded(policies=each), key=key, path=key, name=key)
        for key, each in (("a", "random"), ("b", policies))
    )
    assert continues(one, two) is goes_on


def test_page_is_the_same_every_time(tmp_path: Path) -> None:
    """Equal evidence makes an equal page."""
    recorded(tmp_path / "run")
    one, two = (report(tmp_path / "run", tmp_path / f"{k}.html").read_bytes() for k in "12")
    assert one == two


def test_served_page_asks_for_episodes_itself(tmp_path: Path) -> None:
    """The page that is served may ask where it came from, and leads to others of its server."""
    recorded(tmp_path / "run")
    card = opened(tmp_path / "run", key="a").card
    links = (("The whole report", "report"),)
    page = render(Page("t", "l", (card,), (), is_view=True, links=links))
    assert 'data-view="1"' in page
    assert "connect-src 'self'" in page.replace("&#39;", "'")
    assert ("a", "href", "report") in Read(page).attributes
    assert data_of(page)["episodes"] == []


@pytest.mark.parametrize("content", ["[]", "{", '{"agents": {}}', "nonsense"])
def test_wrong_document_is_refused(tmp_path: Path, content: str) -> None:
    """A file that is no audit is refused with what it is and how to have one."""
    recorded(tmp_path / "run")
    (tmp_path / "audit.json").write_text(content)
    with pytest.raises(EvidenceError, match="isn't of the kind 'audit'") as told:
        report(tmp_path / "run", tmp_path / "p.html", audit=tmp_path / "audit.json")
    assert "audit ENV --json" in told.value.fix
    assert not (tmp_path / "p.html").exists()


@pytest.mark.parametrize(
    ("failure", "expected"),
    [
        (
            "gain > 1e9",
            "0 of 3 episodes failed (failed if gain > 1e9). Return of all agents together: "
            "9 to 11.",
        ),
        (
            None,
            "No condition of failure is declared. Return of all agents together: between 9 and 11.",
        ),
    ],
)
def test_outcome_needs_a_condition(failure: str | None, expected: str) -> None:
    """Where no failure is declared the page doesn't count to zero."""
    run = shown(recorded(failure=failure), key="a", path="run", name="run")
    answers = {each.question: each.text for each in answers_of(run, Documents())}
    assert answers["Outcome"] == expected
    assert answers["Evidence"] == "A run that isn't finalized has no checksums to compare."


def test_lowest_return_names_its_agent_but_no_fault() -> None:
    """Means differ: the lowest has its agent and a link; they are equal: it isn't said."""
    run = shown(recorded(), key="a", path="run", name="run")
    returns = np.zeros_like(run.figures.returns)
    told = []
    for low in (-2.0, 0.0):
        returns = returns.copy()
        returns[:, 1] = low
        other = replace(run, figures=replace(run.figures, returns=returns))
        told.append([a for a in answers_of(other, Documents()) if a.question == "Lowest return"])
    ((answer,), equal) = told
    assert (answer.word, equal) == (run.figures.agents[1], [])
    assert answer.text.startswith("Mean return -2; of the other")
    assert answer.text.endswith("A return alone shows no fault.")
    assert answer.link.startswith("#play:a/0/")


def test_agent_that_adds_least_is_said_with_the_direction_of_its_difference() -> None:
    """Of a harmful agent the team's return is higher without it, and its interval is turned."""
    run = shown(recorded(), key="a", path="run", name="run")

    def said(value: float, low: float, high: float) -> str:
        part = {"value": value, "low": low, "high": high, "baseline": "noop"}
        told = {"agents": {PLAIN[0]: {"difference": part}}}
        answers = answers_of(run, Documents(attribution=told))
        return next(each.text for each in answers if each.question == "Adds least")

    start = "With noop in its place the team's return is "
    assert said(0.5, 0.25, 1.0) == f"{start}0.5 lower (95 % interval 0.25 to 1)."
    assert said(-0.5, -1.0, -0.25) == f"{start}0.5 higher (95 % interval 0.25 to 1)."


def test_cause_links_to_the_turn_of_its_counterfactual() -> None:
    """The likely cause is the diagnosis' own, with the first restored counterfactual's turn."""
    run = shown(recorded(), key="a", path="run", name="run")
    told = documents.diagnosis("w", PLAIN)
    found = {each.question: each for each in answers_of(run, Documents(diagnosis=told))}
    said = found["First difference"].text
    assert "does north (0); after " in said
    assert "it does stay (4), and the episode succeeds. north (0) is 90% of its actions" in said
    cause = found["Likely cause"]
    restored = next(each for each in told["counterfactuals"] if each["restored"])
    assert f"#play:a/{restored['episode']}/{restored['turn']}" == cause.link
    assert (cause.word, "isolated" in cause.text) == ("one_0", True)
    assert "new episodes succeed; unchanged, " in found["Counterfactual"].text


def test_a_cause_that_is_no_agents_own_is_named_with_its_reason() -> None:
    """Messages that are lost, or a cut-off, aren't shown as if no cause was named."""
    run = shown(recorded(), key="a", path="run", name="run")
    told = documents.diagnosis("w", PLAIN)
    own = next(iter(told["agents"].values()))
    lost = {**own, "answer": "environment", "labels": [], "component": "messages, lost"}
    told = {**told, "team": lost, "agents": dict.fromkeys(told["agents"], lost)}
    found = {each.question: each for each in answers_of(run, Documents(diagnosis=told))}
    text = "The cause is messages, lost, no agent's own (environment): w."
    assert (found["Likely cause"].word, found["Likely cause"].text) == ("environment", text)


def test_first_screen_says_which_turn_lost_an_episode() -> None:
    """A pivot is an answer with a link to its turn; without one, the reason is."""
    run = shown(recorded(), key="a", path="run", name="run")
    curve = [{"turn": 0, "share": 0.1, "low": 0.0, "high": 0.2, "successes": 1, "n": 10}]
    fall = {"turn": 4, "loss": "draws", "agents": [], "tried": [], "p": 0.01}
    fall |= {"before": {"share": 0.9}, "after": {"share": 0.2}}
    each = {"episode": 1, "question": "falls", "curve": curve, "not_tried": []}
    left = ["confirming the fall at turn 4: the budget is spent"]
    lost, never, unsure = (
        {a.question: a for a in answers_of(run, Documents(pivots={"episodes": [each | more]}))}
        for more in ({"pivots": [fall]}, {"pivots": []}, {"pivots": [], "not_tried": left})
    )
    assert lost["Lost at"].link == "#play:a/1/4"
    assert "success falls from 90% to 20%; chance lost it" in lost["Lost at"].text
    assert never["Lost at"].text.startswith("No turn of episode 1 is named: continued from")
    assert "budget ended before the fall at turn 4 was confirmed" in unsure["Lost at"].text


def test_equal_values_are_not_called_the_lowest() -> None:
    """A link to the lowest of several says how many others are as low, or that all are equal."""
    run = shown(recorded(failure=None), key="a", path="run", name="run")
    texts = []
    for team in ([3.0, 3.0, 3.0], [2.0, 5.0, 2.0], [2.0, 5.0, 3.0]):
        returns = np.zeros_like(run.figures.returns)
        returns[:, 0] = team
        other = replace(run, figures=replace(run.figures, returns=returns))
        texts += [a.link_text for a in answers_of(other, Documents()) if a.question == "Outcome"]
    assert texts == [
        "episode 0 (all 3 equal)",
        "the lowest, episode 0 (tied with 1 other)",
        "the lowest, episode 0",
    ]


def test_causes_are_counted_apart_from_what_follows() -> None:
    """The rule that is broken is worded as on the command line."""
    run = shown(recorded(), key="a", path="run", name="run")
    cause = {"outcome": "failed", "id": "GK106", "severity": "high", "claim": "It stays."}
    follows = {"follows_from": {"id": "GK106", "held_still": "entries deleted"}}
    told = {"verdicts": [cause, cause | {"id": "GK402"} | follows]}
    found = {each.question: each for each in answers_of(run, Documents(audit=told))}
    assert found["Findings"].word == "1 cause, 1 follows from it"
    assert found["Findings"].lines == ("GK106  Should hold: It stays.",)
    assert (found["Counterfactual"].word, found["Counterfactual"].badge) == ("tested", "tested")


def test_first_screen_compares_and_leads_to_what_else_would_have_been(tmp_path: Path) -> None:
    """The first claim of an evaluation, the command of a replay, and that of playing on."""
    gk.rollout("tictactoe", episodes=1, out=tmp_path / "run")
    run = opened(tmp_path / "run", key="a")
    told = Documents(evaluation={"claims": ["a beats b.", "c."], "refused": [{}]})
    found = {each.question: each for each in answers_of(run, told)}
    assert found["Evaluation"].text == "a beats b. 1 more. 1 refused."
    assert found["Run again"].text.startswith(f"`gamekeeper replay {run.path}`")
    block = not_asked(replace(run, failed=(True,)), told, env="ENV")
    assert block is not None
    assert "pivots" in block.title
    assert f"gamekeeper diagnose {run.path}\n" in block.snippets[0][1]
    undeclared = not_asked(replace(run, failed=(None,)), told, env="ENV")
    assert undeclared is not None
    assert f"gamekeeper diagnose {run.path} --failed 'return < " in undeclared.snippets[0][1]
    assert f"gamekeeper view {run.path} --interactive" in block.snippets[0][1]
    assert "Counterfactual" not in found
    assert (found["State"].word, "Evidence" in found) == ("finalized", False)
    assert found["State"].text.startswith("Every file matches its checksum")


def test_missing_run_is_refused(tmp_path: Path) -> None:
    """There is no page of no run."""
    with pytest.raises(RunError, match="no run"):
        report(tmp_path / "nothing", tmp_path / "p.html")


def test_foreign_runs_are_not_read(tmp_path: Path) -> None:
    """A diagnosis in a run names folders; only those beside the run are looked at."""
    recorded(tmp_path / "elsewhere" / "secret", word="secret")
    recorded(tmp_path / "here" / "run")
    told: dict[str, Any] = documents.diagnosis("w", PLAIN)
    told["runs"] = {"unchanged": str(tmp_path / "elsewhere" / "secret"), "x": "/etc"}
    page = report(tmp_path / "here" / "run", tmp_path / "here" / "p.html", diagnosis=told)
    assert [run["key"] for run in data_of(page.read_text())["runs"]] == ["a"]


def test_counterfactuals_stand_beside_their_base(tmp_path: Path) -> None:
    """Runs that a diagnosis kept are offered pair by pair, with the first turn that differs."""
    recorded(tmp_path / "run")
    kept = tmp_path / "run-diagnosis" / "runs"
    recorded(kept / "0-unchanged", seed=9)
    recorded(kept / "1-noop", seed=9, policies="first-legal")
    told: dict[str, Any] = documents.diagnosis("w", PLAIN)
    told["runs"] = {"policy = first-legal": "moved/1-noop", "unchanged": "moved/0-unchanged"}
    data = data_of(report(tmp_path / "run", tmp_path / "p.html", diagnosis=told).read_text())
    assert [run["key"] for run in data["runs"]] == ["a", "a.unchanged", "a.counterfactual1"]
    counterfactual = next(
        entry for entry in data["episodes"] if entry["run"] == "a.counterfactual1"
    )
    assert {"run": "a.unchanged", "episode": counterfactual["episode"]} == counterfactual["base"]
    assert counterfactual["change"] == "with policy = first-legal"
    assert [
        pair["divergence"]["turn"] for pair in data["pairs"] if pair["left"]["run"] == "a.unchanged"
    ] == [0, 0, 0]
