"""Tests, records and reproduces multi-agent environments; `import gamekeeper as gk` for its names.

Names load when they are first used: the import itself brings neither numpy nor anything heavier.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from gamekeeper import errors
from gamekeeper._version import __version__ as __version__
from gamekeeper.errors import (
    ActionError,
    ContractError,
    DependencyError,
    DivergenceError,
    DrawError,
    EnvError,
    EvidenceError,
    GamekeeperError,
    OrderError,
    PolicyError,
    RunError,
    SpecError,
    TrustError,
)

if TYPE_CHECKING:
    from gamekeeper import vector
    from gamekeeper.auditing.audit_process import audit
    from gamekeeper.auditing.result import AuditResult
    from gamekeeper.checks.verdict import Finding, Verdict
    from gamekeeper.contract import Contract
    from gamekeeper.diagnosis.attribution.agent_measures import Attribution
    from gamekeeper.diagnosis.attribution.contributions import attribute
    from gamekeeper.diagnosis.diagnosis_result import Diagnosis
    from gamekeeper.diagnosis.failure_causes import diagnose
    from gamekeeper.diagnosis.pivot_result import Pivots
    from gamekeeper.diagnosis.pivots import pivots
    from gamekeeper.diagnosis.response_tests import ResponseTest, responses
    from gamekeeper.episodes.divergence import Divergence
    from gamekeeper.episodes.episode import Episode, Turn
    from gamekeeper.episodes.evidence import Evidence
    from gamekeeper.evaluation.claim_check import CheckedClaim, reproduce
    from gamekeeper.evaluation.claim_pack import pack
    from gamekeeper.evaluation.evaluation import Evaluation
    from gamekeeper.evaluation.evaluator import evaluate
    from gamekeeper.interface import wrappers
    from gamekeeper.interface.conversion import to_aec, to_parallel
    from gamekeeper.interface.env_source import Env
    from gamekeeper.interface.tick_env import TickEnv
    from gamekeeper.interface.turn_env import TurnEnv
    from gamekeeper.runs.comparison import Replay, diff, replay
    from gamekeeper.runs.expanding import expand
    from gamekeeper.runs.load_run import load
    from gamekeeper.runs.recording import record, rollout
    from gamekeeper.runs.resuming import Resumed, resume
    from gamekeeper.runs.run_check import Verification, verify
    from gamekeeper.viewing import plot
    from gamekeeper.viewing.episode_player import player
    from gamekeeper.viewing.report_file import report

__all__ = [
    "ActionError",
    "Attribution",
    "AuditResult",
    "CheckedClaim",
    "Contract",
    "ContractError",
    "DependencyError",
    "Diagnosis",
    "Divergence",
    "DivergenceError",
    "DrawError",
    "EnvError",
    "Episode",
    "Evaluation",
    "Evidence",
    "EvidenceError",
    "Finding",
    "GamekeeperError",
    "OrderError",
    "Pivots",
    "PolicyError",
    "Replay",
    "ResponseTest",
    "Resumed",
    "RunError",
    "SpecError",
    "TickEnv",
    "TrustError",
    "Turn",
    "TurnEnv",
    "Verdict",
    "Verification",
    "attribute",
    "audit",
    "diagnose",
    "diff",
    "draft_contract",
    "errors",
    "evaluate",
    "expand",
    "load",
    "make",
    "pack",
    "pivots",
    "player",
    "plot",
    "record",
    "replay",
    "report",
    "reproduce",
    "responses",
    "resume",
    "rollout",
    "to_aec",
    "to_parallel",
    "vector",
    "verify",
    "wrappers",
]

_HOMES: Final = {
    "Attribution": "gamekeeper.diagnosis.attribution.agent_measures",
    "AuditResult": "gamekeeper.auditing.result",
    "Contract": "gamekeeper.contract",
    "Diagnosis": "gamekeeper.diagnosis.diagnosis_result",
    "Divergence": "gamekeeper.episodes.divergence",
    "Evaluation": "gamekeeper.evaluation.evaluation",
    "Evidence": "gamekeeper.episodes.evidence",
    "Finding": "gamekeeper.checks.verdict",
    "Pivots": "gamekeeper.diagnosis.pivot_result",
    "Replay": "gamekeeper.runs.comparison",
    "CheckedClaim": "gamekeeper.evaluation.claim_check",
    "ResponseTest": "gamekeeper.diagnosis.response_tests",
    "Resumed": "gamekeeper.runs.resuming",
    "TickEnv": "gamekeeper.interface.tick_env",
    "Episode": "gamekeeper.episodes.episode",
    "Turn": "gamekeeper.episodes.episode",
    "TurnEnv": "gamekeeper.interface.turn_env",
    "Verdict": "gamekeeper.checks.verdict",
    "Verification": "gamekeeper.runs.run_check",
    "attribute": "gamekeeper.diagnosis.attribution.contributions",
    "audit": "gamekeeper.auditing.audit_process",
    "diagnose": "gamekeeper.diagnosis.failure_causes",
    "diff": "gamekeeper.runs.comparison",
    "evaluate": "gamekeeper.evaluation.evaluator",
    "expand": "gamekeeper.runs.expanding",
    "load": "gamekeeper.runs.load_run",
    "pack": "gamekeeper.evaluation.claim_pack",
    "pivots": "gamekeeper.diagnosis.pivots",
    "player": "gamekeeper.viewing.episode_player",
    "record": "gamekeeper.runs.recording",
    "replay": "gamekeeper.runs.comparison",
    "report": "gamekeeper.viewing.report_file",
    "reproduce": "gamekeeper.evaluation.claim_check",
    "responses": "gamekeeper.diagnosis.response_tests",
    "resume": "gamekeeper.runs.resuming",
    "rollout": "gamekeeper.runs.recording",
    "to_aec": "gamekeeper.interface.conversion",
    "to_parallel": "gamekeeper.interface.conversion",
    "verify": "gamekeeper.runs.run_check",
}
"""The module of each name, which is loaded when the name is first used."""
_PACKAGES: Final = {
    "plot": "gamekeeper.viewing.plot",
    "vector": "gamekeeper.vector",
    "wrappers": "gamekeeper.interface.wrappers",
}
"""Packages that are public themselves: `gk.vector.make`, `gk.plot.returns`."""


def make(spec: object, /, *, slim: bool = True, **kwargs: Any) -> Env:
    """Makes an AECEnv or ParallelEnv from an id, `module:factory`, `file.py:factory` or a factory.

    `parallel:` or `aec:` in front of a text selects the API. PettingZoo's own wrappers and
    converters around the rules are replaced by one faster wrapper with the same promises;
    `gamekeeper show ENV` lists those that are replaced.

    Args:
        spec: the environment.
        slim: False: keep all wrappers.
        **kwargs: keyword arguments of the factory.
    Raises:
        SpecError: the environment can't be opened; the error names the places that were searched.
    """
    from gamekeeper.interface import slim as slimming
    from gamekeeper.interface.identity import remember
    from gamekeeper.interface.opening import open_env

    opened = open_env(spec, **kwargs)
    env = slimming.slim(opened.env) if slim else opened.env
    remember(env, opened.identity)
    return env


def draft_contract(spec: object, /, **kwargs: Any) -> Contract:
    """Drafts a contract as far as the environment shows it before its first step.

    `gamekeeper contract ENV` lists the declarations that are missing.

    Args:
        spec: the environment; an environment object stays open.
        **kwargs: keyword arguments of the factory.
    Raises:
        SpecError: the environment can't be opened.
    """
    from gamekeeper.interface import contract_draft
    from gamekeeper.interface.opening import open_env

    opened = open_env(spec, **kwargs)
    try:
        return contract_draft.draft_contract(opened.env)
    finally:
        if opened.make is not None:
            opened.env.close()


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return importlib.import_module(_PACKAGES[name])
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, getattr(importlib.import_module(_HOMES[name]), name))


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
