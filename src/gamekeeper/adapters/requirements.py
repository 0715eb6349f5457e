"""Requirements that are met before training: a passed audit, and a policy for every other agent.

The audit is quick and runs before the first step, once for each environment in a process. An agent
that doesn't learn acts at random only where its policy says so: its own, its role's, or one of all.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import blake2b
from typing import Any, Final

import numpy as np

from gamekeeper.adapters.shared_observations import alike
from gamekeeper.auditing.audit_process import audit
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.errors import ContractError, PolicyError, SpecError
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.joint_policy import Choices, JointPolicy
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.policy import EVERYONE
from gamekeeper.runs.recording import joint_policy_of

PASSED: Final[dict[str, object]] = {}
"""Environments that passed the audit in this process, by identity as JSON.

An environment that isn't named by a text is told from others of its name by its address in memory,
so a reference to it is held: its address isn't given to another object.
"""


def checked(
    spec: object, check: str | None, *, env_kwargs: Mapping[str, Any] | None = None
) -> None:
    """Audits an environment that is about to be trained on, unless that was done in this process.

    Args:
        spec: where it comes from.
        check: "quick"; None skips the audit.
        env_kwargs: arguments of the environment.
    Raises:
        SpecError: `check` is something else.
        ContractError: the environment breaks its contract, which no trainer would notice.
    """
    if check is None:
        return
    if check != "quick":
        raise SpecError(
            "there is no such check",
            where="check",
            expected='"quick" or None',
            actual=check,
            fix='check="quick" audits before training, check=None does not',
        )
    opened = open_env(spec, **dict(env_kwargs or {}))
    opened.env.close()
    name = to_json({**opened.identity, "at": None if isinstance(spec, str) else id(spec)})
    if name in PASSED:
        return
    sys.stderr.write(f"gamekeeper: audits {opened.spec} before training (check=None: doesn't)\n")
    found = audit(spec, quick=True, env_kwargs=env_kwargs)
    high = [verdict for verdict in found.failed if verdict.severity == "high"]
    if high:
        raise ContractError(
            f"{opened.spec} breaks its contract",
            where=", ".join(verdict.id for verdict in high),
            expected="no failed check of high severity",
            actual="; ".join(f"{verdict.id} {verdict.claim}" for verdict in high)[:800],
            fix=f"gamekeeper audit {opened.spec} shows how to see it again; "
            "check=None trains all the same",
        )
    for verdict in found.failed:
        sys.stderr.write(f"gamekeeper: {verdict.id} failed: {verdict.claim}\n")
    _warn_of_likeness(spec, env_kwargs)
    PASSED[name] = spec


def _warn_of_likeness(spec: object, env_kwargs: Mapping[str, Any] | None) -> None:
    """Says on stderr which agents a shared policy couldn't tell apart."""
    opened = open_env(spec, **dict(env_kwargs or {}))
    try:
        contract = declared_contract(None, opened)
        joint_policy = joint_policy_of("random", opened.env, contract)
        found = alike(opened.env, joint_policy, opened.api, lambda agent: role_of(contract, agent))
    finally:
        opened.env.close()
    for agents, comparisons in found.values():
        sys.stderr.write(
            f"gamekeeper: {', '.join(map(str, agents))} were shown the same observation in all "
            f"{comparisons} comparisons: a policy that they share can't tell them apart "
            "(fix: gk.wrappers.agent_id shows each its number; or train a policy for each)\n"
        )


@contextmanager
def closed_on_error(env: Any) -> Iterator[None]:
    """Closes an environment if the block raises."""
    try:
        yield
    except BaseException:
        env.close()
        raise


def role_of(contract: Contract | None, agent: Any) -> str:
    """Role of an agent, by the contract, else by its name."""
    declared = None if contract is None else contract.role_of(agent)
    return declared or role_in_name(str(agent))


def learners_of(agents: Iterable[Any], role: str | None, contract: Contract | None) -> list[Any]:
    """Agents of a role, or the one agent of that name, in the order given; None: all agents.

    Raises:
        SpecError: the environment has none.
    """
    whole = list(agents)
    found = [agent for agent in whole if role in (None, role_of(contract, agent), str(agent))]
    if not found:
        raise SpecError(
            f"the environment has no agent with the role {role!r}",
            where="role",
            expected=", ".join(dict.fromkeys(role_of(contract, agent) for agent in whole)),
            actual=repr(role),
            fix="name a role or an agent of the environment, or leave role out: all agents learn",
        )
    return found


def require_policies(rest: Sequence[Any], others: Choices, contract: Contract | None) -> None:
    """Refuses agents without a policy, and policies where every agent learns.

    Args:
        rest: agents that don't learn.
        others: their policies, one for all or by agent or role.
        contract: of the environment; None: roles are read from names.
    Raises:
        SpecError: an agent has no policy, or there is no agent to follow one.
    """
    if not rest and others:
        raise SpecError(
            "policies are given for other agents, and all agents learn",
            where="others",
            expected="None",
            actual=repr(others)[:200],
            fix="name the role that learns, or leave others out",
        )
    without: Sequence[Any] = rest if others is None else ()
    if isinstance(others, Mapping) and EVERYONE not in others:
        without = [a for a in rest if str(a) not in others and role_of(contract, a) not in others]
    if without:
        given = ", ".join(map(str, others)) if isinstance(others, Mapping) else "no agent"
        raise SpecError(
            "agents that don't learn have no policy",
            where="others",
            expected=f"policies for {', '.join(map(str, without))}",
            actual=f"policies for {given}",
            fix="others='random', or others={'role': 'module:callable'}",
        )


def policies_of_others(
    spec: object,
    env_kwargs: Mapping[str, Any] | None,
    rest: Sequence[Any],
    others: Choices,
    contract: Contract | None,
    num_envs: int,
) -> list[JointPolicy]:
    """Policies of the agents that don't learn, a joint policy for each sub-environment.

    A policy that is an object is shared by all sub-environments, one that is a class or a name is
    made for each. Empty where every agent learns.

    Raises:
        SpecError: see `require_policies`.
    """
    require_policies(rest, others, contract)
    if not rest:
        return []
    env = open_env(spec, **dict(env_kwargs or {})).env
    try:
        return [joint_policy_of(others, env, contract) for _ in range(num_envs)]
    finally:
        env.close()


def not_learnt(agent: Any, learners: Iterable[str]) -> PolicyError:
    """Error of a policy that is asked to play an agent that didn't learn."""
    return PolicyError(
        f"{agent!r} isn't among the agents that learnt",
        where="policy",
        expected=", ".join(learners),
        actual=str(agent),
        fix="give it another policy",
    )


def weights_digest(named: Iterable[tuple[str, Any]]) -> str:
    """Digest of torch tensors with their names, 16 hexadecimal digits; their order counts."""
    digest = blake2b(digest_size=8)
    for name, value in named:
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(value.detach().cpu().numpy()).tobytes())
    return digest.hexdigest()
