"""An environment and policies as they are installed now, looked at in a worker."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.canon import from_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.core.space.plain import space_to_json
from gamekeeper.errors import GamekeeperError, SpecError
from gamekeeper.game.declared import declared_contract
from gamekeeper.game.draft import agent_specs
from gamekeeper.game.open import open_env
from gamekeeper.game.opening.opened import Opened
from gamekeeper.game.policy import distrust_policy
from gamekeeper.record.recording import cast_of
from gamekeeper.record.tasks import error_fields

TASK: Final = "gamekeeper.record.now:now_task"


def now_task(
    report: Callable[..., None],
    *,
    spec: str,
    kwargs: str,
    contract: str | None,
    api: str | None,
    policies: Sequence[str],
) -> dict[str, Any]:
    """Opens an environment as it is installed now, in a worker, without a reset or a step.

    Args:
        spec: names the environment.
        kwargs: its arguments, in canonical JSON.
        contract: a contract's file in place of the one beside it.
        api: asked for where the spec asks for none.
        policies: names of policies whose versions are wanted.
    Returns:
        `identity`, `contract`, `spaces` by agent, `policies`: a version by name, or what was in
        the way as `{"error": text}`; or the fields of the `error` that was in the way of all.
    """
    del report
    try:
        given: Any = from_json(kwargs)
        opened = _opened(spec, api, given)
        try:
            declared = declared_contract(contract, opened)
            specs = agent_specs(opened.env, declared or Contract())
            versions = {name: _version(name, opened.env, declared) for name in policies}
        finally:
            opened.env.close()
    except GamekeeperError as error:
        return {"error": error_fields(error)}
    return {
        "error": None,
        "identity": opened.identity,
        "contract": None if declared is None else declared.to_json(),
        "spaces": {
            each.name: {
                "observation": _space(each.observation_space), "action": _space(each.action_space)
            }
            for each in specs
        },
        "policies": versions,
    }  # fmt: skip


def askable(names: Sequence[str], *, allow_import: bool) -> list[str]:
    """The policies whose version may be looked up: those that are code only where it is allowed."""
    return [name for name in names if allow_import or distrust_policy(name) is None]


def _opened(spec: str, api: str | None, kwargs: Mapping[str, Any]) -> Opened:
    """The environment, behind the API that it was recorded with unless the spec names one."""
    if spec.startswith(("parallel:", "aec:")) or api is None:
        return open_env(spec, **kwargs)
    try:
        return open_env(spec, api=api, **kwargs)
    except SpecError:
        return open_env(spec, **kwargs)  # it has another API now: a row tells


def _version(name: str, env: Any, contract: Any) -> dict[str, str | None]:
    try:
        cast = cast_of(name, env, contract)
        agent = next(iter(getattr(env, "possible_agents", None) or ["*"]))
        return {"version": cast.described([agent])[agent_name(agent)]["version"]}
    except GamekeeperError as error:
        return {"error": error.what}


def _space(space: Any) -> Any:
    return None if space is None else space_to_json(space)
