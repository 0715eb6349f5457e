"""Figures of an evaluation, worked out from its recorded runs; nothing is played or opened."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from math import isclose
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import outcome_of
from gamekeeper.errors import RunError
from gamekeeper.evaluation.episode_rows import Success, rows_of, table_of
from gamekeeper.evaluation.evaluator import judged_of
from gamekeeper.evaluation.inspection import Inspection
from gamekeeper.evaluation.matchups import Match, matches_of
from gamekeeper.evaluation.spec import CrossplaySpec, EnvironmentSpec, PolicySpec, Spec, StopSpec

NEAR: Final = 1e-9
"""Largest relative difference between a figure and itself, summed in another order."""
LABELS: Final = ("environment", "policy", "a", "b", "run", "step", "who", "metric", "cell", "name")
"""Keys of a row that name it."""
WORDS: Final = ("method", "claim", "why")
"""Keys of texts, which may be absent."""


def runs_of(document: Mapping[str, Any], name: str) -> dict[tuple[str, str], str]:
    """Folders of an evaluation's recorded runs, by environment and pairing.

    Raises:
        RunError: it recorded none, or one of them couldn't be recorded or came out otherwise.
    """
    rows = document.get("evidence") or ()
    trouble = [row for row in rows if "folder" not in row or row.get("differs")]
    if not rows or trouble or not document.get("spec"):
        raise RunError(
            "an evaluation can't be claimed without runs that replay it",
            where=name,
            expected="a recorded run of every line-up",
            actual=f"no usable run of {trouble[0].get('pairing')}" if trouble else "none",
            fix="evaluate again with --record digest, and the same --out",
        )
    return {(row["environment"], row["pairing"]): str(row["folder"]) for row in rows}


def policy_files(document: Mapping[str, Any]) -> list[str]:
    """Files of an evaluation's policies that lie here: those it lists, and those it plays from."""
    found: list[str] = []
    for policy in document["policies"].values():
        choices = [text for run in policy["choices"] for text in run.values()]
        texts = [part for text in choices for part in text.split(":", 1) + text.rsplit(":", 1)]
        found += [each for each in (*policy["files"], *texts) if each and Path(each).is_file()]
    return list(dict.fromkeys(found))


def figures_in(document: Mapping[str, Any]) -> dict[str, float | None]:
    """Every number of an evaluation's results, comparisons, curves, cross-play and overall table.

    By a name such as `results, grid, random, team, return: mean.low`.
    """
    found: dict[str, float | None] = {}
    for part in ("results", "comparisons", "curves", "crossplay", "overall"):
        for name, value in _numbers(document.get(part), part):
            key, number = name, 2
            while key in found:
                key, number = f"{name} ({number})", number + 1
            found[key] = value
    return found


def is_same(claimed: float | None, seen: float | None) -> bool:
    """Tells if two figures are equal but for the order of a sum."""
    if claimed is None or seen is None:
        return claimed is seen
    return isclose(claimed, seen, rel_tol=NEAR, abs_tol=NEAR)


def worked_out(
    document: Mapping[str, Any], runs: Mapping[tuple[str, str], Evidence]
) -> dict[str, float | None]:
    """The figures of `figures_in`, from recorded runs in place of the evaluation's own episodes.

    Where playing was stopped by an interval, its rows' intervals are those of a fixed number.
    """
    spec = _spec(document["spec"])
    inspections = {name: _inspection(document, name, runs) for name in spec.environments}
    matches = matches_of(spec, inspections, is_here=True)
    rows = [row for match in matches for row in _rows(spec, match, inspections, runs)]
    figures, _, _ = judged_of(spec, inspections, matches, table_of(rows))
    return figures_in(figures)


def _rows(
    spec: Spec,
    match: Match,
    inspections: Mapping[str, Inspection],
    runs: Mapping[tuple[str, str], Evidence],
) -> Iterator[dict[str, Any]]:
    """Raw episodes of a line-up, from its run."""
    environment, pairing = match.environment, match.pairing.name
    contract = inspections[environment].declared
    success = Success(contract, spec.environments[environment].success)
    for number, episode in enumerate(runs[environment, pairing].episodes):
        label = {"environment": environment, "pairing": pairing, "episode": number, "reset": None}
        yield from rows_of(
            outcome_of(episode),
            label=label,
            sides={position: (side.policy, side.run) for position, side in match.pairing.sides},
            # not the empty steps that close an AEC agent's life: policies don't choose them
            lengths=Counter(a for turn in episode.turns for a in turn.order if a not in turn.ended),
            success=success,
            contract=contract,
            roster=list(inspections[environment].roles),
            infos=spec.infos,
        )


def _inspection(
    document: Mapping[str, Any], name: str, runs: Mapping[tuple[str, str], Evidence]
) -> Inspection:
    """Inspection of an environment, as the evaluation and one of its runs have it."""
    its = document["environments"][name]
    declared: Contract | None = next(run.contract for (env, _), run in runs.items() if env == name)
    policies = {
        policy: tuple(each["by_environment"].get(name, ()))
        for policy, each in document["policies"].items()
    }
    contract = None if declared is None else declared.to_json()
    return Inspection(its["digest"], its["version"], its["api"], its["agents"], contract, policies)


def _spec(plain: Mapping[str, Any]) -> Spec:
    """Inverse of `Spec.to_json`; contracts are those of the runs."""
    given = {name: _tuples(value) for name, value in plain.items()}
    environments = {
        name: EnvironmentSpec(**{"spec": None, **_known(EnvironmentSpec, row), "contract": None})
        for name, row in plain.get("environments", {}).items()
    }
    policies = {
        name: PolicySpec(**_known(PolicySpec, row))
        for name, row in plain.get("policies", {}).items()
    }
    crossplay = CrossplaySpec(**_known(CrossplaySpec, plain.get("crossplay", {})))
    stop = StopSpec(**_known(StopSpec, plain["stop"])) if plain.get("stop") else None
    parts = {"environments": environments, "policies": policies}
    return Spec(**{**_known(Spec, given), **parts, "crossplay": crossplay, "stop": stop})


def _known(kind: Any, row: Mapping[str, Any]) -> dict[str, Any]:
    names = {each.name for each in fields(kind)}
    return {name: _tuples(value) for name, value in row.items() if name in names}


def _tuples(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return tuple(map(_tuples, value))
    if isinstance(value, Mapping):
        return {name: _tuples(part) for name, part in value.items()}
    return value


def _numbers(value: Any, name: str, path: str = "") -> Iterator[tuple[str, float | None]]:
    """Numbers of plain data, each by its row's labels and its path in the row."""
    if isinstance(value, bool | str):
        return
    if value is None or isinstance(value, int | float):
        yield (f"{name}: {path}" if path else name), value
    elif isinstance(value, Mapping):
        own = {key: value[key] for key in LABELS if isinstance(value.get(key), str | int)}
        if not path and own:
            name = ", ".join([name, *map(str, own.values())])
        for key, part in value.items():
            if key not in own and key not in WORDS:
                yield from _numbers(part, name, f"{path}.{key}" if path else str(key))
    elif isinstance(value, Sequence):
        for place, part in enumerate(value):
            is_row = isinstance(part, Mapping) and not path
            yield from _numbers(part, name, path if is_row else f"{path}[{place}]")
