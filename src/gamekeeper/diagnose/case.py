"""A diagnosed failure as a pytest case: it still fails, and its remedy still restores."""

from __future__ import annotations

import json
import pprint
from os import PathLike
from typing import Any, Final

from gamekeeper.core.evidence import Evidence
from gamekeeper.core.outcome import failed as told_failed
from gamekeeper.core.outcome import failures, outcome_of
from gamekeeper.diagnose.diagnosis import Diagnosis
from gamekeeper.errors import EvidenceError
from gamekeeper.record.bundle import load

_TEXT: Final = '''"""{title}

Diagnosed from the run {fingerprint}: {why}.
"""

from __future__ import annotations

from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.core.outcome import failed, failures, outcome_of

SEED = {seed}
EPISODES = {episodes}
CONDITION = {condition}
SCOPE = {scope!r}
ARMS: dict[str, dict[str, Any]] = {arms}


def failing(arm: str) -> int:
    """How many episodes of an arm fail."""
    evidence = gk.rollout(episodes=EPISODES, seed=SEED, **ARMS[arm])
    conditions = failures(evidence.contract, CONDITION)
    told = [failed(outcome_of(trace), conditions, evidence.contract) for trace in evidence.traces]
    return sum(each[SCOPE] for each in told)


def test_failure_is_there_as_it_is() -> None:
    """As it is, {failed_as_is} of {episodes} episodes failed when this was diagnosed."""
    assert failing("as it is") >= {least}


@pytest.mark.parametrize("arm", [arm for arm in ARMS if arm != "as it is"])
def test_remedy_restores(arm: str) -> None:
    """With the remedy, fewer than half of those fail."""
    assert failing(arm) <= {most}
'''


def case_text(diagnosis: Diagnosis, run: str | PathLike[str], *, failed: str | None = None) -> str:
    """A test file that plays the failure and its remedies again, on the confirmed seeds.

    Args:
        diagnosis: has bundles of what restores, from `diagnose(..., out=...)`.
        run: the folder of the run.
        failed: the condition that was given.
    Raises:
        EvidenceError: no remedy restores, so there is nothing to hold on to.
    """
    if len(diagnosis.bundles) < 2:
        raise EvidenceError(
            "no remedy restores, so there is no case to save",
            where="--save-case", expected="a named cause", seen="none",
            mend="declare more knobs in the contract, or play more episodes (--budget)",
        )  # fmt: skip
    everybody = [*([diagnosis.team] if diagnosis.team else []), *diagnosis.agents.values()]
    found = next(each for each in everybody if each.remedies)
    arms: dict[str, Any] = {}
    counts: list[int] = []
    for arm, folder in diagnosis.bundles.items():
        evidence = load(folder)
        arms["as it is" if not arms else arm] = _arguments(evidence)
        counts.append(_failing(evidence, failed, found.scope))
    episodes = load(next(iter(diagnosis.bundles.values()))).episodes.num_rows
    seed = load(next(iter(diagnosis.bundles.values()))).manifest["seed"]
    return _TEXT.format(
        title=_words(f"{' and '.join(found.labels).capitalize()}: a failure that was diagnosed."),
        fingerprint=_words(diagnosis.fingerprint[:16]), why=_words(found.why), seed=seed,
        episodes=episodes, condition=repr(failed) if failed else "None", scope=found.scope,
        arms=_python(arms), failed_as_is=counts[0], least=max(counts[0] // 2, 1),
        most=max((counts[0] - 1) // 2, max(counts[1:])),
    )  # fmt: skip


def _arguments(evidence: Evidence) -> dict[str, Any]:
    identity = evidence.manifest["environment"]
    policies = json.loads(evidence.episodes["policies"][0].as_py())
    return {
        "spec": f"{identity['api']}:{identity['entry_point']}",
        "env_kwargs": identity.get("kwargs") or {},
        "policies": {agent: entry["policy"] for agent, entry in policies.items()},
    }


def _failing(evidence: Evidence, condition: str | None, scope: str) -> int:
    conditions = failures(evidence.contract, condition)
    contract = evidence.contract
    told = [told_failed(outcome_of(trace), conditions, contract) for trace in evidence.traces]
    return sum(each.get(scope, False) for each in told)


def _words(text: str) -> str:
    """Words for a docstring: whatever they are, they don't end it, and stay on their line."""
    plain = "".join(sign if sign.isprintable() else " " for sign in text)
    return plain.replace("\\", "\\\\").replace('"', "'")


def _python(arms: dict[str, Any]) -> str:
    """As a literal that a person can read."""
    return pprint.pformat(arms, width=96, sort_dicts=False)
