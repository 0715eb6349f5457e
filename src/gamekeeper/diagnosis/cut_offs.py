"""Cut-offs: the turn at which recorded episodes were truncated, and the argument that says so."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from gamekeeper.episodes.outcome import Outcome

HORIZONS: Final = ("max_cycles", "max_steps", "episode_limit", "horizon", "max_episode_steps")
"""Names of the argument that cuts an episode off, in several libraries."""


def truncating_turn(outcomes: Iterable[Outcome]) -> int | None:
    """The one number of turns after which episodes were truncated; None: none was, or several.

    An episode counts where all of its agents were truncated.
    """
    turns = {each.turns for each in outcomes if _is_truncated(each)}
    return turns.pop() if len(turns) == 1 else None


def cuts_of(
    failed: Sequence[Outcome], env: Any, kwargs: Mapping[str, Any], agents: int
) -> dict[str, int]:
    """The arguments by which an environment cut every failed episode off.

    Args:
        failed: the recorded episodes that failed.
        env: opened; one of `HORIZONS` may be an attribute of it that wasn't given.
    """
    if not all(_is_truncated(each) for each in failed):
        return {}
    inner = env.unwrapped
    held = {name: getattr(inner, name, None) for name in HORIZONS}
    return cutting_arguments({**held, **kwargs}, truncating_turn(failed), agents)


def _is_truncated(outcome: Outcome) -> bool:
    """All of its agents were truncated."""
    return bool(outcome.flags) and all(flag == "truncated" for flag in outcome.flags.values())


def early_cut(failed: Sequence[Outcome], horizon: int | None) -> int | None:
    """The turn at which every failed episode was truncated, before the declared horizon."""
    turn = truncating_turn(failed) if all(map(_is_truncated, failed)) else None
    return turn if turn is not None and horizon is not None and turn < horizon else None


def cutting_arguments(given: Mapping[str, Any], turn: int | None, agents: int) -> dict[str, int]:
    """The arguments whose value is the truncating turn, counted in turns or in rounds of agents."""
    if turn is None:
        return {}
    whole = {k: x for k, x in given.items() if isinstance(x, int) and not isinstance(x, bool)}
    # A round is a turn of each agent; the last may be broken off or followed by farewells.
    return {
        name: value
        for name, value in whole.items()
        if value > 0 and (value == turn or (agents > 1 and 0 <= turn - value * agents <= agents))
    }
