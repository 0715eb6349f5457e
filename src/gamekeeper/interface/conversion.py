"""Conversions between PettingZoo's two APIs: one agent after the other, or all at once."""

from typing import Any, Final

from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import aec_to_parallel_wrapper, parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from gamekeeper.contract import Contract
from gamekeeper.errors import SpecError
from gamekeeper.interface.to_aec import ToAEC
from gamekeeper.interface.to_parallel import ToParallel

DECLARED: Final = "as declared"
STYLES: Final = ("cycle", "turn")


def to_aec(env: Any) -> AECEnv[Any, Any, Any]:
    """The same game, one agent after the other.

    An AEC environment is handed back as it is, and one that `to_parallel` converted is unpacked;
    anything else becomes a `ToAEC`, whose docstring says what is kept, changed and lost.

    Args:
        env: a ParallelEnv; it now belongs to the converted environment.
    Raises:
        SpecError: it is no PettingZoo environment.
    """
    if isinstance(env, AECEnv):
        return env
    if type(env) is ToParallel:
        return env.env
    if type(env) is aec_to_parallel_wrapper:
        return env.aec_env
    if isinstance(env, ParallelEnv):
        return ToAEC(env)
    raise _no_environment(env, "to_aec", "a ParallelEnv")


def to_parallel(
    env: Any, *, order: str | None = None, style: str = "cycle"
) -> ParallelEnv[Any, Any, Any]:
    """The same game, all agents at once.

    A Parallel environment is handed back as it is, and one that `to_aec` converted is unpacked;
    anything else becomes a `ToParallel`, whose docstring says what is kept, changed and lost.

    Args:
        env: an AECEnv; it now belongs to the converted environment.
        order: "as declared" where the environment doesn't say that a round of its turns can be one
            tick: all choose by what they see as the tick begins, and their actions are played in
            the environment's own order.
        style: "cycle": a tick is a round of turns; "turn": a tick is one turn, and only the action
            of the agent in turn counts.
    Raises:
        SpecError: a round of its turns isn't declared to be one tick; or it is no environment.
    """
    _check_options(order, style)
    if isinstance(env, ParallelEnv):
        return env
    if style == "cycle":
        if type(env) is ToAEC:
            return env.env
        if type(env) is OrderEnforcingWrapper and type(env.env) is parallel_to_aec_wrapper:
            return env.env.env
    if not isinstance(env, AECEnv):
        raise _no_environment(env, "to_parallel", "an AECEnv")
    if style == "cycle" and order is None and not is_parallelizable(env):
        raise _unlike_ticks(env)
    return ToParallel(env, style=style)


def is_parallelizable(env: AECEnv[Any, Any, Any]) -> bool:
    """Tells whether an AEC environment declares that nothing changes within a round of its turns.

    It says so in `metadata["is_parallelizable"]`, or its contract does: observations show what was
    after the tick.
    """
    if (getattr(env, "metadata", None) or {}).get("is_parallelizable", False):
        return True
    form = getattr(env.unwrapped, "declared", None)
    return isinstance(form, Contract) and form.schedule.observe == "after tick"


def _check_options(order: str | None, style: str) -> None:
    if order not in (None, DECLARED) or style not in STYLES:
        raise SpecError(
            "there is no such conversion",
            where="to_parallel",
            expected=f"order=None or {DECLARED!r}, style={' or '.join(map(repr, STYLES))}",
            actual=f"order={order!r}, style={style!r}",
            fix="leave order and style out, or choose one of these",
        )


def _no_environment(given: Any, where: str, expected: str) -> SpecError:
    return SpecError(
        "only a PettingZoo environment can be converted",
        where=where,
        expected=expected,
        actual=f"{type(given).__module__}.{type(given).__qualname__}",
        fix=f"open it first: {where}(gamekeeper.make(spec))",
    )


def _unlike_ticks(env: AECEnv[Any, Any, Any]) -> SpecError:
    metadata = getattr(env, "metadata", None) or {}
    return SpecError(
        f"{metadata.get('name', type(env).__name__)} can't be opened as parallel",
        where="to_parallel",
        expected="metadata['is_parallelizable'] = True: a round of turns is one tick",
        actual=f"metadata['is_parallelizable'] = {metadata.get('is_parallelizable')!r}",
        fix="open it as aec; set the key where its agents do act all at once; or convert it "
        f"with order={DECLARED!r}, where all may choose before the first acts, or style='turn'",
    )
