"""An evaluation as text."""

import re
from typing import Any

import pytest

from gamekeeper.reporting.evaluation_text import evaluation_text

INTERVAL = {"value": 1.2345678, "low": 1.1, "high": 1.4, "method": "bootstrap-t"}
ENDINGS = {"terminated": 3, "truncated": 1, "cut": 0, "reasons": {"met": 3, "horizon": 1}}


def row(**more: Any) -> dict[str, Any]:
    """A result."""
    return {
        "environment": "line",
        "policy": "mine",
        "run": 0,
        "scope": "team",
        "who": "team",
        "metric": "return",
        "episodes": 50,
        "runs": 1,
        "mean": INTERVAL,
        "median": 1.0,
        "iqm": INTERVAL,
        "quantiles": {"0.05": 0.5, "0.25": 1, "0.75": 2, "0.95": 3},
        "success": {"hits": 3, "n": 4, "p": 0.75, "low": 0.3, "high": 0.95},
        "endings": ENDINGS,
        **more,
    }


def document(**more: Any) -> dict[str, Any]:
    """An evaluation."""
    return {
        "kind": "evaluation",
        "name": "lines",
        "suite": None,
        "seed": 0,
        "level": 0.95,
        "environments": {"line": {}},
        "policies": {"mine": {}},
        "results": [row()],
        "comparisons": [],
        "crossplay": {},
        "stopping": None,
        "refused": [],
        "claims": [],
        "episodes": 50,
        "fingerprint": "f" * 32,
        **more,
    }


def test_evaluation_text_shows_figures_with_their_intervals() -> None:
    """Mean, middle half, quantiles, n; success and endings apart."""
    text = evaluation_text(document(), width=80)
    assert "1.23 (1.10 to 1.40)" in text
    assert "75 % (30 to 95)" in text
    assert "met 3, horizon 1" in text


def test_evaluation_text_explains_its_columns_and_no_others() -> None:
    """IQM and success, but no word of Gymnasium's; a kind of ending that is absent isn't shown."""
    text = evaluation_text(document(), width=80)
    columns = text.partition("Columns\n")[2]
    for word in ("of", "IQM", "success"):
        assert f"  {word} " in columns
    for word in ("terminated", "truncated", "episodes "):
        assert f"  {word} " not in columns
    assert "cut" not in text
    assert "P(A > B)" not in text
    ends = {**ENDINGS, "cut": 2}
    text = evaluation_text(document(results=[row(endings=ends)]), width=80)
    assert "terminated  truncated  cut  reasons" in text
    assert "  cut        episodes that were stopped while agents were live" in text


def test_evaluation_text_has_no_negative_zero() -> None:
    """Of figures without an interval, quantiles, cells of cross-play, and differences."""
    none = {"value": -0.0, "low": None, "high": None, "method": None}
    cell = {"roles": {"p": "mine", "c": "mine"}, "kind": "self", "n": 50, "mean": -0.0}
    cell |= {"low": None, "high": None, "by_role": {"p": -0.0, "c": -1e-300}}
    lead = {"policies": ["mine", "mine"], "roles": ["p", "c"], "n": 50, "first_mover": none}
    crossed = {"roles": ["p", "c"], "who": "p", "cells": [cell], "best_response": []}
    crossed["fairness"] = [{**lead, "difference": None}]
    apart = {
        "environment": "line",
        "a": "mine",
        "b": "yours",
        "scope": "team",
        "who": "team",
        "metric": "return",
    }
    apart |= {"difference": {**none, "p": 1.0, "effect_size": -0.001}, "improvement": None}
    low = row(mean=none, iqm=none, quantiles=dict.fromkeys(("0.05", "0.95"), -0.0))
    found = document(results=[low], crossplay={"line": crossed}, comparisons=[apart])
    text = evaluation_text(found, width=110)
    assert re.search(r"-0(\.0*)?(?![\d.e])", text) is None, text
    assert "P(A > B)   probability that A is above B" in text
    assert "an equal pair counts half" in " ".join(text.split())


def test_evaluation_text_keeps_notes_apart_from_claims() -> None:
    """Claims come before the tables; a sentence on how it was played is no claim."""
    found = document(notes=["All policies played."], claims=["line: a is above b."])
    text = evaluation_text(found, width=80)
    heads = [line for line in text.splitlines() if line[:1].isalpha()]
    assert heads[1] == "Supported claims"
    assert "Supported claims\n  line: a is above b.\n\n" in text
    assert text.endswith("Notes\n  All policies played.")


def test_evaluation_text_shows_a_figure_without_interval_alone() -> None:
    """And why there is none, at the end."""
    mean = {**INTERVAL, "low": None, "high": None}
    refused = [{"what": "interval of the mean", "why": "too few episodes"}]
    text = evaluation_text(document(results=[row(mean=mean)], refused=refused), width=80)
    assert "1.235" in text
    assert "Refused claims\n  interval of the mean: too few episodes" in text
    refused.append({"what": "interval of the median", "why": "too few episodes"})
    text = evaluation_text(document(results=[row(mean=mean)], refused=refused), width=80)
    assert "claims\n  interval of the mean; likewise 1 more: too few episodes" in text


def test_evaluation_text_shows_methods_over_their_runs_and_lists_these() -> None:
    """One row for the method; its runs in one line."""
    runs = [row(run=k, mean={**INTERVAL, "value": float(k)}) for k in range(3)]
    over = row(run=None, runs=3, success=None, endings=None)
    text = evaluation_text(document(results=[*runs, over]), width=80)
    assert "3 runs" in text
    assert "runs of mine, team: 0, 1, 2" in text


def test_evaluation_text_shows_agents_side_by_side_by_policy() -> None:
    """Where a team or a role stands above them."""
    agents = [
        row(
            policy=policy, scope="agent", who=who, mean={**INTERVAL, "value": 7.0 + k}, endings=None
        )
        for k, policy in enumerate(("mine", "yours"))
        for who in ("p_0", "p_1")
    ]
    text = evaluation_text(document(results=[row(), *agents]), width=80)
    assert "agent  mine  yours" in text
    assert "p_1       7      8" in text


@pytest.mark.parametrize("width", [66, 80, 110])
def test_evaluation_text_stays_within_its_width(width: int) -> None:
    """Comparisons, cross-play, best responses, fairness, claims."""
    cells = [
        {
            "roles": {"p": "mine", "c": "mine"},
            "kind": "self",
            "n": 50,
            "mean": 1.0,
            "low": 0.5,
            "high": 1.5,
            "by_role": {"p": 1.0, "c": None},
        }
    ]
    best = {
        "role": "p",
        "against": {"c": "mine"},
        "policy": "mine",
        "value": 1.0,
        "gap": {"yours": INTERVAL},
        "note": "n",
    }
    fair = {
        "policies": ["mine", "yours"],
        "roles": ["p", "c"],
        "n": 50,
        "first_mover": INTERVAL,
        "difference": None,
    }
    crossplay = {
        "line": {
            "roles": ["p", "c"],
            "who": "team",
            "cells": cells * 40,
            "best_response": [best],
            "fairness": [fair],
        }
    }
    compared = {
        "environment": "line",
        "a": "mine",
        "b": "yours",
        "scope": "team",
        "who": "team",
        "metric": "return",
        "difference": {**INTERVAL, "p": 0.01},
        "improvement": None,
    }
    text = evaluation_text(
        document(
            crossplay=crossplay,
            comparisons=[compared],
            claims=["word " * 40],
            suite={"id": "s-1", "version": "1", "fingerprint": "0" * 8},
        ),
        width=width,
    )
    assert "more pairings" in text
    assert "p leads by 1.23 (1.10 to 1.40)" in " ".join(text.split())
    long = [line for line in text.splitlines() if len(line) > width]
    assert long == []


def test_evaluation_text_shows_performance_profiles_of_methods() -> None:
    """The part of the runs above a few scores; of single checkpoints there is none."""
    figures = dict.fromkeys(("iqm", "mean", "median", "optimality_gap"), INTERVAL)
    profile = {"tau": [0.0, 0.25, 0.3, 0.5, 0.75, 0.9], "share": [1.0, 0.8, 0.7, 0.5, 0.25, 0.0]}
    of = {"metric": "score", "runs": 10, "profile": profile, **figures}
    rows = [{"policy": "mine", "unit": "run", **of}, {"policy": "other", "unit": "episode", **of}]
    text = evaluation_text(document(overall={"results": rows, "comparisons": []}), width=100)
    assert re.search(r"share of runs above +metric +0 +0.25 +0.5 +0.75 +0.9\n", text)
    assert re.search(r"mine +score +100 % +80 % +50 % +25 % +0 %\n", text)
    assert not re.search(r"other +score +100 %", text)
