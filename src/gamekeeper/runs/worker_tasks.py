"""Tasks of worker processes: record a rollout, look at a structure, compare it with a run."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict
from threading import Event, Thread
from time import monotonic
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import from_json
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.spaces.space_json import space_to_json
from gamekeeper.errors import EnvError, GamekeeperError, SpecError
from gamekeeper.interface.construction import foreign_traceback
from gamekeeper.interface.contract_draft import agent_specs, draft_contract, draft_questions
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.env_source import Opened
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.policy import distrust_policy
from gamekeeper.interface.slim import described_slim
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.runs.recording import RolloutProgress, joint_policy_of, record_rollout
from gamekeeper.terminal import say

# -- What worker processes do with environments: record a rollout, look at a structure
#
# A task returns plain data. An error of the user's (`GamekeeperError`) is data too; any other
# error that is raised here is a fault of ours and comes out as one.

PROGRESS_S: Final = 0.05
"""Seconds between two reports of progress."""
BEAT_S: Final = 0.05
"""Seconds between two signs of life; less than the shortest silence that may be allowed."""

Report = Callable[..., None]


def record_task(report: Report, *, plan: Mapping[str, Any], out: str) -> dict[str, Any]:
    """Plays and records a plan, as `rollout` does; reports turns and episodes on the way.

    Returns:
        `{"error": None}`, or the fields of the error that ended it.
    """
    try:
        wanted = RolloutPlan.from_json(plan)
        record_rollout(wanted, out, progress=reported(report, wanted.episodes))
    except EnvError as error:
        if error.__cause__ is not None:
            say(foreign_traceback(error.__cause__))
        return {"error": error.to_json()}
    except GamekeeperError as error:
        return {"error": error.to_json()}
    return {"error": None}


def contract_task(
    report: Report,
    *,
    spec: str,
    env_kwargs: Mapping[str, Any],
    contract: str | None,
    policies: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Opens an environment and looks at its structure, without a reset or a step.

    Args:
        policies: by agent, role or `*`; one that can't play here is refused.
    Returns:
        `contract` (declared or drafted), `is_declared`, `agents` with their spaces, `questions`,
        `made_of` (its wrappers: replaced by `gk.make`, or kept); or the fields of the `error`.
    """
    try:
        opened = open_env(spec, **env_kwargs)
        with closing(opened.env):
            declared = declared_contract(contract, opened)
            form = declared if declared is not None else draft_contract(opened.env)
            specs = agent_specs(opened.env, form)
            questions = draft_questions(opened.env, form)
            made_of = described_slim(opened.env)
            if policies:
                joint_policy_of(policies, opened.env, declared)
    except GamekeeperError as error:
        return {"error": error.to_json()}
    return {
        "error": None,
        "name": form.name or opened.identity["name"],
        "contract": form.to_json(),
        "is_declared": declared is not None,
        "agents": [
            {
                "name": each.name,
                "observation_space": _space(each.observation_space),
                "action_space": _space(each.action_space),
            }
            for each in specs
        ],
        "questions": [asdict(question) for question in questions],
        "made_of": list(made_of),
    }


def _space(space: Any) -> dict[str, Any] | None:
    return None if space is None else space_to_json(space)


@contextmanager
def signs_of_life(report: Report) -> Iterator[None]:
    """Gives signs of life while no foreign code runs: finalizing a long run takes its time."""
    is_over = Event()

    def beat() -> None:
        while not is_over.wait(BEAT_S):
            report()

    thread = Thread(target=beat, name="gamekeeper-alive", daemon=True)
    with suppress(RuntimeError):  # no memory is left for one: finalizing goes on without
        thread.start()
    try:
        yield
    finally:
        is_over.set()
        if thread.ident is not None:
            thread.join()


def reported(report: Report, episodes: int) -> RolloutProgress:
    """Reports turns and episodes of a rollout, and gives signs of life while it is finalized."""
    return RolloutProgress(
        counter(report, episodes), lambda done: report(episode=done), lambda: signs_of_life(report)
    )


def counter(report: Report, episodes: int) -> Callable[[], None]:
    """Counts turns; reports them now and then, and is a sign of life at each."""
    turns = 0
    last_s = monotonic()
    report(turns=0, episodes=episodes)

    def count() -> None:
        nonlocal turns, last_s
        turns += 1
        now_s = monotonic()
        if now_s - last_s >= PROGRESS_S:
            last_s = now_s
            report(turns=turns)

    return count


# -- An environment and policies as they are installed now, looked at in a worker

TASK: Final = "gamekeeper.runs.worker_tasks:now_task"


def now_task(
    report: Report,
    *,
    spec: str,
    kwargs: str,
    contract: str | None,
    api: str | None,
    policies: Sequence[str],
) -> dict[str, Any]:
    """Opens an environment as it is installed now, in a worker, without a reset or a step.

    Args:
        kwargs: its arguments, in canonical JSON.
        contract: a contract's file in place of the one beside it.
        api: asked for where the spec asks for none.
        policies: names of policies whose versions are wanted.
    Returns:
        `identity`, `contract`, `spaces` by agent, `policies`: a version by name, or
        `{"error": text}`; or the fields of the `error` that prevented all of this.
    """
    del report
    try:
        given: Any = from_json(kwargs)
        opened = _opened(spec, api, given)
        with closing(opened.env):
            declared = declared_contract(contract, opened)
            specs = agent_specs(opened.env, declared or Contract())
            versions = {name: _version(name, opened.env, declared) for name in policies}
    except GamekeeperError as error:
        return {"error": error.to_json()}
    return {
        "error": None,
        "identity": opened.identity,
        "contract": None if declared is None else declared.to_json(),
        "spaces": {
            each.name: {
                "observation": _space(each.observation_space),
                "action": _space(each.action_space),
            }
            for each in specs
        },
        "policies": versions,
    }


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
        return open_env(spec, **kwargs)  # it has another API now: a row of the comparison says so


def _version(name: str, env: Any, contract: Any) -> dict[str, str | None]:
    try:
        chosen = joint_policy_of(name, env, contract)
        agent = next(iter(getattr(env, "possible_agents", None) or ["*"]))
        return {"version": chosen.described([agent])[agent_name(agent)]["version"]}
    except GamekeeperError as error:
        return {"error": error.what}
