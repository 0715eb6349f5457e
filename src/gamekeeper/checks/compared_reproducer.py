"""Proofs that play an episode twice, as it is and with a trigger, and compare the two."""

from typing import Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.reproducer_source import text_of
from gamekeeper.checks.reproducers import overwrite, overwrite_masks
from gamekeeper.episodes.canonical import shown
from gamekeeper.episodes.divergence import Divergence

LATE: Final = ("reward", "raised", "rows", "order")
"""Fields that are made by their turn's step: they are seen once it is over."""
WORDS: Final = {
    "obs": "observation",
    "cumulative_reward": "reward",
    "live": "roster",
    "rows": "list of agents with a row",
}

_PARALLEL = '''\
def story(meddle):
    """All that an episode gives, with `meddle` called between its steps."""
    env = make()
    out = env.reset(seed=SEED)
    told = [copy.deepcopy(out)]
    meddle(env, out)
    for actions in ACTIONS:
        out = env.step(copy.deepcopy(actions))
        told.append(copy.deepcopy(out))
        meddle(env, out)
{next}    return told
'''
_AEC = '''\
def story(meddle):
    """All that an episode gives, with `meddle` called between its steps."""
    env = make()
    env.reset(seed=SEED)
    told = []
    for action in [*ACTIONS, None]:
        if not env.agents:
            break
{early}        told.append((env.agent_selection, copy.deepcopy(env.last()){part}))
        if len(told) < 2 * len(ACTIONS):
            meddle(env, None)
            env.step(copy.deepcopy(action))
            told.append(dict(env.rewards))
{next}    return told
'''
_EARLY = """\
        for _ in range(1 + len(told) // 2 % 2):
            meddle(env, None)
"""
_NEXT = {
    "parallel": "    told.append(copy.deepcopy(env.reset()))\n",
    "aec": "    env.reset()\n"
    "    told.append((env.agent_selection, copy.deepcopy(env.last()[0])))\n",
}
OVERWRITE: Final = text_of(overwrite)[0]
"""Defines `overwrite` for a snippet: as that of `run.handed`, and leaves action masks alone."""
OVERWRITE_MASKS: Final = text_of(overwrite_masks)[0]
"""Defines `overwrite_masks` for a snippet, and `overwrite`."""


def story_proof(
    api: str,
    meddling: str,
    *,
    idle: str = "pass",
    first: str = "",
    infos: bool = True,
    early: bool = False,
    is_next: bool = False,
) -> Reproducer:
    """Raises while the same actions go another way once `meddling` stands between the steps.

    Args:
        api: `aec` or `parallel`.
        meddling: Python over `env` and (Parallel) `out`, what reset or step returned.
        idle: what stands there in the episode that it is compared with.
        first: lines before all others.
        infos: in an AEC environment, whether infos are compared too.
        early: in an AEC environment, meddle before `last()` too, at every second turn twice, not
            only before `step`.
        is_next: what the next reset gives, without a seed, is compared too.
    """
    told = _PARALLEL
    if api == "aec":
        before = _EARLY if early else ""
        told = _AEC.replace("{part}", "" if infos else "[:4]").replace("{early}", before)
    told = told.replace("{next}", _NEXT[api] if is_next else "")
    lines = (
        f"{first}{told}\n"
        f"def meddle(env, out):\n{_indented(meddling)}\n"
        f"def leave(env, out):\n{_indented(idle)}\n"
    )
    return Reproducer(
        f"{lines}np.testing.assert_equal(story(meddle), story(leave))",
        plays=False,
        imports=("copy",),
        compares=True,
        unchanged=f"{lines}np.testing.assert_equal(story(leave), story(leave))",
    )


def _indented(lines: str) -> str:
    return "".join(f"    {line}\n" for line in lines.splitlines())


def first_divergence_words(first_divergence: Divergence) -> str:
    """In words where an episode went another way, with both values where they are short."""
    field = WORDS.get(first_divergence.field, first_divergence.field)
    whose = "" if first_divergence.agent is None else f" of {first_divergence.agent!r}"
    one, other = shown(first_divergence.recorded), shown(first_divergence.replayed)
    is_short = len(one) + len(other) < 60 and "\n" not in one + other and one != other
    values = f" is {other} in place of {one}" if is_short else " is another"
    return f"at turn {first_divergence.turn} the {field}{whose}{values}"


def env_steps_of(first_divergence: Divergence) -> int | None:
    """Number of steps after which the divergence shows."""
    turn = first_divergence.turn
    return None if turn is None else turn + (first_divergence.field in LATE)
