"""The table of bars: what is wanted is well said, and the page shows what is kept."""

import argparse
import re
import shlex
from typing import Any

import pytest

from benchmarks import bars, bars_page, bars_read
from tests.surface.sources import ROOT

RUNS = bars.runs()
BARS = [(run, bar) for run in RUNS for bar in run["bar"]]
WAYS = ("most", "least", "within", "all", "equal")
LINES: list[dict[str, Any]] = [
    {"task": "a", "us": 3.0, "by": {"2": 1.5, "8": 2.5}, "good": 4, "all": 5, "same": True},
    {"task": "b", "us": 6.0, "by": {"2": 4.5}, "good": 2, "all": 2, "same": False},
    {"task": "c", "why": "not installed", "us": None},
]


def names(run_or_pair: Any) -> str:
    """What a test is called by."""
    if isinstance(run_or_pair, dict):
        return str(run_or_pair["name"])
    run, bar = run_or_pair
    return f"{run['name']}/{bar['name']}"


def test_the_page_shows_the_results_that_are_kept() -> None:
    """Who keeps a result, or asks for something else, writes the table: bars.py --table --write."""
    page = bars.PAGE.read_text("utf-8")
    assert bars_page.page_with(page, RUNS, bars.results()) == page


def test_results_belong_to_a_command() -> None:
    """No figure is kept of a command or a bar that nobody asks for any more."""
    asked = {run["name"]: {bar["name"] for bar in run["bar"]} for run in RUNS}
    for name, kinds in bars.results().items():
        assert set(kinds) <= {"usual", "whole"}
        for entry in kinds.values():
            assert set(entry["bars"]) <= asked[name], name


def test_names_are_said_once() -> None:
    """A command and a bar can be named without doubt."""
    assert len(RUNS) == len({run["name"] for run in RUNS})
    assert len(BARS) == len({names(pair) for pair in BARS})


@pytest.mark.parametrize("run", RUNS, ids=names)
def test_a_command_names_a_script_and_options_that_exist(run: dict[str, Any]) -> None:
    """What the page tells the reader to type is there to be typed."""
    for text in (run[key] for key in ("command", "whole", "before") if key in run):
        python, script, *words = shlex.split(text)
        source = (ROOT / script).read_text("utf-8")
        assert python == "python"
        options = [word[2:] for word in words if word.startswith("--")]
        # Some scripts add theirs in a loop over names.
        there = [f'"--{word}"' in source or f'"{word}"' in source for word in options]
        assert all(there), options


@pytest.mark.parametrize("pair", BARS, ids=names)
def test_a_bar_wants_one_thing_and_says_how_it_is_read(pair: Any) -> None:
    """A bar has one way of being reached, or none: then it is a figure beside the others."""
    _, bar = pair
    assert sum(way in bar for way in WAYS) <= 1
    assert set(bar) <= {*WAYS, "name", "what", "read", "spread", "scale", "unit", "wanted", "looks"}
    assert bar["read"].keys() <= {"where", "take", "fold", "between", "of", "over", "plus"}


@pytest.mark.parametrize(
    ("how", "value"),
    [
        ({"where": {"task": "a"}, "take": "us"}, 3.0),
        ({"where": {"task": ["a", "b"]}, "take": "us", "fold": "max"}, 6.0),
        ({"take": "by.*", "fold": "min"}, 1.5),
        ({"take": "us", "fold": "median"}, 4.5),
        ({"take": "same", "fold": "all"}, [1, 2]),
        ({"take": "good", "of": "all"}, [6, 7]),
        ({"take": "us", "fold": "share_in", "between": [5, 7]}, [1, 2]),
        ({"where": {"task": "x"}, "take": "us", "fold": "count"}, 0),
        ({"where": {"task": "b"}, "take": "us", "over": {"take": "us", "fold": "min"}}, 2.0),
        ({"where": {"task": "b"}, "take": "us", "plus": [{"take": "us", "fold": "min"}]}, 9.0),
    ],
)
def test_read_finds_a_figure(how: dict[str, Any], value: Any) -> None:
    """Lines are chosen by their fields, figures by their place, many become one."""
    assert bars_read.read(LINES, how) == value


def test_read_says_what_isnt_there() -> None:
    """A peer that isn't installed leaves no figure, and no silent zero."""
    with pytest.raises(LookupError, match="'c'"):
        bars_read.read(LINES, {"where": {"task": "c"}, "take": "us"})
    found = bars_read.figure_of([LINES], {"read": {"where": {"task": "c"}, "take": "us"}})
    assert found["value"] is None
    assert bars_page.reached({"most": 1}, found) is None


def test_figures_of_several_runs_have_their_spread() -> None:
    """The median, the least and the most; counts are added up; what must be so always must."""
    every = [[{"us": us, "ok": us < 4, "n": 1, "of": 2}] for us in (3.0, 5.0, 4.0)]
    how = {"read": {"take": "us"}}
    assert bars_read.figure_of(every, how) == {"value": 4.0, "low": 3.0, "high": 5.0}
    assert bars_read.figure_of(every, {"read": {"take": "ok"}}) == {"value": False}
    assert bars_read.figure_of(every, {"read": {"take": "n", "of": "of"}}) == {"value": [3, 6]}


@pytest.mark.parametrize(
    ("bar", "value", "is_reached"),
    [
        ({"most": 5}, 5.0, True),
        ({"most": 5}, 5.1, False),
        ({"least": 1.7}, 1.69, False),
        ({"all": True}, [46, 46], True),
        ({"all": True}, [45, 46], False),
        ({"least": 95, "unit": "%"}, [19, 20], True),
        ({"most": 5, "unit": "%"}, [2, 20], False),
        ({"least": 95, "looks": 200}, [40, 40], False),
        ({"equal": True}, False, False),
        ({"within": [93, 97]}, 95.0, True),
        ({}, 3.0, None),
        ({"most": 1}, None, None),
    ],
)
def test_reached_compares_with_what_is_wanted(
    bar: dict[str, Any], value: Any, is_reached: bool | None
) -> None:
    """Too few looks reach nothing; what wasn't measured is neither reached nor missed."""
    assert bars_page.reached(bar, {"value": value}) is is_reached


def test_a_whole_run_outweighs_a_short_one_where_that_is_said() -> None:
    """A short form of a statistic shows that it runs; what it says is for the whole one."""
    bar = {"name": "x", "what": "x", "most": 1}
    kept = {
        "r": {
            kind: {"bars": {"x": {"value": value}}} for kind, value in (("usual", 2), ("whole", 1))
        }
    }
    assert bars_page.verdict({"name": "r", "judge": "whole"}, bar, kept) == "yes"
    assert bars_page.verdict({"name": "r"}, bar, kept) == "no"


def test_a_command_gets_the_peers_and_the_interpreter_that_are_named() -> None:
    """What lives in an environment of its own is run by that environment's Python, or skipped."""
    run = {
        "name": "r",
        "command": "python a.py --out SCRATCH/x",
        "python": "nobody",
        "peers": ["p"],
    }
    assert bars.missing(run, {}) == "needs --python nobody=PATH"
    named = {"nobody": "/n/python", "p": "/p/python"}
    assert bars.missing(run, named) is None
    assert bars.command_of(run, named, scratch="/s") == [
        "/n/python",
        "a.py",
        "--out",
        "/s/x",
        "--peer",
        "p=/p/python",
    ]


def test_measured_keeps_what_a_command_prints(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Date, load, what else was at work, and each figure, of what a script printed among others."""
    script = tmp_path / "told.py"
    script.write_text("print('hello')\nprint('{\"us\": 4}')\n")
    bar = {"name": "us", "what": "a step", "read": {"take": "us"}, "most": 5}
    run = {"name": "told", "command": f"python {script}", "bar": [bar]}
    options = argparse.Namespace(whole=False, repeats=2)
    entry = bars.measured(run, {}, options)
    assert entry["bars"] == {"us": {"value": 4.0}}
    assert {"date", "load", "others", "seconds", "command", "python"} <= set(entry)
    monkeypatch.setattr(bars, "RESULTS", tmp_path)
    bars.keep(run, entry, whole=False)
    assert bars.results()["told"]["usual"]["bars"] == {"us": {"value": 4.0}}


def test_keep_leaves_a_figure_that_was_not_found_again(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run without a peer doesn't take away what an earlier one measured beside it."""
    monkeypatch.setattr(bars, "RESULTS", tmp_path)
    bar = {"name": "peer", "what": "to a peer", "read": {"take": "us"}, "unit": "s"}
    run = {"name": "r", "command": "python r.py", "bar": [bar]}
    for date, value in (("2026-01-01", 7.0), ("2026-02-02", None), ("2026-03-03", None)):
        entry = {"date": date, "load": 1.0, "others": 0.1, "bars": {"peer": {"value": value}}}
        bars.keep(run, entry, whole=False)
    row = bars_page.row(run, bar, bars.results())
    assert row == "| to a peer |  | 7 s | no bar | r | 2026-01-01 | 1.0 |"


def test_scripts_start_by_their_file() -> None:
    """A script that imports from the repository's root puts the root on the path first.

    `python benchmarks/NAME.py`, as every page writes it, puts only benchmarks/ there.
    """
    scripts = sorted((ROOT / "benchmarks").glob("*.py"))
    rooted = re.compile(r"^from (benchmarks|tests)[. ]", re.MULTILINE)
    asking = {path.name for path in scripts if rooted.search(path.read_text("utf-8"))}
    lacking = {
        name
        for name in asking
        if "sys.path.insert(0, str(Path(__file__).parent"
        not in rooted.split((ROOT / "benchmarks" / name).read_text("utf-8"))[0]
    }
    assert len(asking) > 3
    assert lacking == set()
