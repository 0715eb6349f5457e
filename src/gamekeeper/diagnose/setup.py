"""What a run was played with, read from its evidence, so that it can be played again otherwise."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, Final

from gamekeeper.core.canon import from_json, is_exact, to_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.errors import EvidenceError, TrustError
from gamekeeper.game.contract_file import load_contract
from gamekeeper.game.open import distrust
from gamekeeper.game.opening.identity import spec_of
from gamekeeper.game.policy import distrust_policy
from gamekeeper.record.recording import MOST_TURNS
from gamekeeper.run.change import Change

CUT: Final = "cut"
REFERENCE: Final = "reference"
"""The policy that an environment brings for how it is meant to be played."""


@dataclass(frozen=True, slots=True)
class Setup:
    """Everything that is chosen before an episode begins, but for its seed.

    Attributes:
        spec: where the environment comes from.
        kwargs: arguments of the environment.
        options: of the resets, taken in turn: episode k has those at place k modulo their number.
        policies: by agent or role, under `*` for all others.
        settings: attributes of policies, by agent and name.
        layers: attributes of wrappers of the environment, by name.
        forgets: agents whose policy's memory is reset before each of its decisions.
        most_turns: episodes are cut there.
        change: what a rerun does otherwise.
        typical_turns: median length of the recorded episodes; nothing is played by it.
    """

    spec: Any
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    options: tuple[Any, ...] = (None,)
    policies: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    layers: Mapping[str, Any] = field(default_factory=dict)
    forgets: tuple[str, ...] = ()
    most_turns: int = MOST_TURNS
    change: Change | None = None
    typical_turns: int | None = None

    def policy_of(self, agent: str, contract: Contract) -> Any:
        """What plays an agent: its own choice, its role's, or everybody's; None: nobody says."""
        role = contract.role_of(agent) or role_in_name(agent)
        return self.policies.get(agent, self.policies.get(role, self.policies.get("*")))

    def to_json(self) -> dict[str, Any]:
        """Plain data that a worker process builds the same set-up from.

        Raises:
            EvidenceError: it holds an object that no text can build again.
        """
        text = to_json([self.kwargs, self.options, self.settings, self.layers])
        named = all(isinstance(policy, str) for policy in self.policies.values())
        if not (isinstance(self.spec, str) and named and is_exact(text)):
            raise EvidenceError(
                "the environment or a policy is an object of this process",
                where="workers", expected="names, which another process can open",
                seen="an object", mend="workers=0 plays in this process",
            )  # fmt: skip
        return {
            "spec": self.spec, "given": text, "policies": dict(self.policies),
            "forgets": list(self.forgets), "most_turns": self.most_turns,
            "change": None if self.change is None else self.change.to_json(),
        }  # fmt: skip

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Setup:
        """What `to_json` gave."""
        given: Any = from_json(data["given"])
        kwargs, options, settings, layers = given
        change = data["change"]
        return cls(
            spec=data["spec"], kwargs=kwargs, options=tuple(options), policies=data["policies"],
            settings=settings, layers=layers, forgets=tuple(data["forgets"]),
            most_turns=data["most_turns"],
            change=None if change is None else Change.from_json(change),
        )  # fmt: skip


def setup_of(
    evidence: Evidence,
    *,
    env: object | None = None,
    policies: Mapping[str, Any] | None = None,
    allow_import: bool = False,
) -> Setup:
    """The set-up of a recorded run.

    Args:
        env: opened in place of what the evidence names, with the recorded arguments.
        policies: in place of the recorded ones, by agent, role or under `*`.
        allow_import: run code that the evidence names.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: it names no policies, or an argument that can't be built again.
        SpecError: the environment was an object in memory, and none is given.
    """
    identity = evidence.manifest["environment"]
    named = _named_policies(evidence) if policies is None else dict(policies)
    is_ours = evidence.path is None  # what this process has just played needs nobody's leave
    if not (allow_import or is_ours):
        _check_trust(evidence, named if policies is None else {}, env)
    spec = spec_of(identity) if env is None else env
    if isinstance(spec, str) and env is not None and ":" not in spec.split("/")[0][:9]:
        spec = f"{identity.get('api')}:{spec}" if identity.get("api") else spec
    text = json.dumps(identity.get("kwargs") or {}, separators=(",", ":"))
    if not is_exact(text):
        raise EvidenceError(
            "an argument of the environment was an object that no text can build again",
            where="kwargs", seen=text[:200], mend="record with plain arguments",
        )  # fmt: skip
    kwargs: Any = from_json(text)
    rows = evidence.episodes.to_pylist()
    cuts = [row["turns"] for row in rows if row["end"] == CUT]
    options = [row["options"] for row in rows] or [None]
    lengths = [row["turns"] for row in rows if row["turns"]]
    return Setup(
        spec=spec,
        kwargs=kwargs,
        options=tuple(None if each is None else from_json(each) for each in options),
        policies=named,
        most_turns=max(cuts) if cuts else MOST_TURNS,
        typical_turns=sorted(lengths)[len(lengths) // 2] if lengths else None,
    )


def contract_of(evidence: Evidence, contract: Contract | str | PathLike[str] | None) -> Contract:
    """The contract to go by: the one that is given, a path is read, else the recording's."""
    if contract is None:
        return evidence.contract
    return contract if isinstance(contract, Contract) else load_contract(contract)


def _named_policies(evidence: Evidence) -> dict[str, str]:
    rows = [row["policies"] for row in evidence.episodes.to_pylist()]
    try:
        named = [json.loads(text) for text in rows if text]
        found = {agent: str(entry["policy"]) for each in named for agent, entry in each.items()}
    except (ValueError, TypeError, KeyError, AttributeError):
        found = {}
    if not found:
        raise EvidenceError(
            "the run doesn't name the policies that played it, so nobody can choose again",
            where="policies",
            expected="a run of gk.rollout or gamekeeper record",
            seen="none",
            mend="name them, as --policy picker=module:callable",
        )
    return found


def _check_trust(evidence: Evidence, policies: Mapping[str, Any], env: object | None) -> None:
    reason = None if env is not None else distrust(evidence.manifest["environment"])
    for name in sorted({str(policy) for policy in policies.values()}):
        reason = reason or distrust_policy(name)
    if reason is not None:
        raise TrustError(
            "playing this run again would execute code that its evidence names",
            where=str(evidence.path),
            seen=reason,
            mend="if you trust it, say --allow-import",
        )
