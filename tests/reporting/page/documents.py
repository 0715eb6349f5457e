"""Documents as the commands print them, with one word wherever words stand."""

from typing import Any


def audit(word: str, agents: tuple[str, str]) -> dict[str, Any]:
    """Two broken promises, one kept, one unseen, and an influence matrix."""
    one, two = agents
    finding = {"where": word, "expected": word, "actual": word, "fix": word, "reproducer": word}
    verdict = {
        "id": "GK101",
        "claim": word,
        "outcome": "failed",
        "severity": "low",
        "confidence": 1.0,
        "cases": 9,
        "failed": 2,
        "reason": "",
        "findings": [finding],
    }
    return {
        "environment": word,
        "api": "parallel",
        "ok": False,
        "seconds": 1.0,
        "steps": 100,
        "seed": 3,
        "verdicts": [
            verdict,
            {**verdict, "id": "GK402", "severity": "high"},
            {**verdict, "id": "GK500", "outcome": "passed", "findings": []},
            {**verdict, "id": "GK600", "outcome": "not_exercised", "reason": word, "findings": []},
        ],
        "measured": {
            "order": "none",
            "deterministic": True,
            "horizon": 7,
            "reward": {"by_agent": {one: {"least": 0.0}}, "shared": None},
            "influence": [
                {
                    "from": one,
                    "to": two,
                    "on": "observation",
                    "lag": 1,
                    "p": 0.5,
                    "low": 0.4,
                    "high": 0.6,
                    "n": 30,
                },
                {
                    "from": two,
                    "to": two,
                    "on": "reward",
                    "lag": 0,
                    "p": 1.0,
                    "low": 0.9,
                    "high": 1.0,
                    "n": 30,
                },
            ],
            "advice": "parallel",
            "why": word,
        },
        "agents": {one: {}, two: {}},
        "declared": {"schedule": {"horizon": 8}, "why": word},
    }


def diagnosis(word: str, agents: tuple[str, str]) -> dict[str, Any]:
    """One isolated cause, one agent without a cause, one counterfactual."""
    tested = {
        "label": "control",
        "intervention": word,
        "kind": "ideal",
        "effect": 0.5,
        "low": 0.3,
        "high": 0.7,
        "p": 0.001,
        "n": 64,
        "measure": "success",
        "restores": True,
    }
    perturbation = {
        **tested,
        "kind": "perturbation",
        "measure": "return",
        "effect": -1.0,
        "low": -2.0,
        "high": -0.5,
        "depends": True,
    }
    answer = {
        "answer": "isolated",
        "labels": ["control"],
        "component": "its control",
        "why": word,
        "scope": "team",
        "success": {"share": 0.1, "low": 0.0, "high": 0.2},
        "substitutes": [word],
        "tested": [tested, perturbation],
        "not_tested": [{"label": "timing", "why": word}],
    }
    other = {**answer, "answer": "elsewhere", "component": None, "labels": [], "tested": []}
    return {
        "run": word,
        "fingerprint": "0",
        "agents": {agents[0]: answer, agents[1]: other},
        "team": None,
        "recorded": {"team": {"failed": 1, "episodes": 3}},
        "counterfactuals": [
            {
                "episode": 1,
                "intervention": word,
                "turn": 2,
                "agent": agents[0],
                "field": "action",
                "failed": True,
                "restored": True,
                "restored_open": False,
                "did": "north (0)",
                "instead": "stay (4)",
                "often": ["north (0)", 0.9, 0.4],
            }
        ],
        "expected": 0.9,
        "part": 0.7,
        "episodes": 640,
        "seed": 5,
        "runs": {},
    }


def attribution(word: str, agents: tuple[str, str]) -> dict[str, Any]:
    """The second agent is lazy, of the first it can't be told; it pays for the other."""
    measured = {"value": 1.0, "low": 0.5, "high": 1.5, "p": 0.01, "n": 50, "baseline": word}
    part = {
        "return": 3.0,
        "terms": {},
        "share": 0.5,
        "idle": 0.1,
        "difference": measured,
        "turn": {"all": measured, "one": None},
        "shapley": measured,
        "lazy": None,
        "lazy_why": word,
        "fair_share": 0.5,
    }
    few = {**measured, "low": None, "high": None, "n": 4}
    return {
        "run": word,
        "episodes": 3,
        "fresh": 50,
        "loop": "closed",
        "baseline": word,
        "team": {"all": 6.0, "none": 0.0, "shapley": "exact"},
        "agents": {agents[0]: part, agents[1]: {**part, "difference": few, "lazy": True}},
        "influence": [],
        "messages": [
            {"kind": "signalling", "from": agents[0], "to": None, "bits": 0.5, "p": 0.01, "n": 50}
        ],
        "penalties": [
            {
                "agent": agents[0],
                "term": word,
                "by": {agents[1]: 3},
                "p": 0.5,
                "low": 0.2,
                "high": 0.8,
                "n": 6,
                "first": {"episode": 1, "seed": 4, "turn": 2, "paid": -1.0},
            }
        ],
        "not_tested": [{"what": word, "why": word}],
    }


def evaluation(word: str, agents: tuple[str, str]) -> dict[str, Any]:
    """Two policies in one environment, with a cross-play matrix."""
    mean = {"value": 1.0, "low": 0.5, "high": 1.5, "method": word}
    result = {
        "environment": word,
        "policy": word,
        "run": None,
        "scope": "agent",
        "who": agents[0],
        "metric": "return",
        "episodes": 100,
        "runs": 10,
        "mean": mean,
        "median": mean,
        "iqm": mean,
        "quantiles": {"0.05": 0.0, "0.95": 2.0},
        "success": {"hits": 3, "n": 10, "p": 0.3, "low": 0.1, "high": 0.6},
        "endings": {"terminated": 3, "truncated": 0, "cut": 0, "reasons": {word: 3}},
    }
    cells = [
        {
            "roles": {"red": one, "blue": two},
            "kind": "self" if one == two else "zero-shot",
            "n": 50,
            "mean": float(len(one + two)),
            "low": 0.0,
            "high": 9.0,
            "by_role": {"red": 1.0, "blue": 2.0},
        }
        for one in (word, "other")
        for two in (word, "other")
    ]
    return {
        "kind": "evaluation",
        "name": word,
        "suite": {"id": word, "fingerprint": "12"},
        "seed": 0,
        "environments": {
            word: {
                "spec": word,
                "kwargs": {},
                "digest": "1",
                "version": word,
                "api": "parallel",
                "roles": ["red", "blue"],
            }
        },
        "policies": {word: {"runs": 10, "digests": ["3"], "is_method": True}},
        "results": [
            result,
            {**result, "scope": "team", "who": "team", "mean": None, "success": None},
        ],
        "comparisons": [
            {
                "environment": word,
                "a": word,
                "b": "other",
                "scope": "team",
                "who": "team",
                "metric": "return",
                "unit": "episode",
                "n": 50,
                "difference": {"value": 1.0, "low": 0.5, "high": 1.5, "p": 0.01},
                "improvement": {"value": 0.7, "low": 0.6, "high": 0.8},
                "claim": word,
            }
        ],
        "crossplay": {
            word: {
                "roles": ["red", "blue"],
                "policies": [word, "other"],
                "cells": cells,
                "best_response": [
                    {
                        "role": "red",
                        "against": {"blue": word},
                        "policy": word,
                        "value": 2.0,
                        "gap": {word: {"value": 0.1, "low": 0.0, "high": 0.2}},
                    }
                ],
                "fairness": [{"policies": word, "least": 0.1}],
            }
        },
        "stopping": None,
        "refused": [{"what": word, "why": word}],
        "claims": [word],
        "episodes": 400,
        "commands": [word],
    }
