"""Proofs that tell a play twice, as it is and with something meddled in, and compare the two."""

from __future__ import annotations

from typing import Final

from gamekeeper.core.canon import shown
from gamekeeper.core.divergence import Divergence
from gamekeeper.core.proof import Proof

LATE: Final = ("reward", "raised", "rows", "order")
"""Fields that are made by their turn's crossing: they are seen once it is over."""
WORDS: Final = {"obs": "observation", "received": "reward", "live": "roster"}

_PARALLEL = '''\
def story(meddle):
    """All that a play gives, with `meddle` called between its steps."""
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
    """All that a play gives, with `meddle` called between its steps."""
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
_NEXT = {
    "parallel": "    told.append(copy.deepcopy(env.reset()))\n",
    "aec": "    env.reset()\n"
    "    told.append((env.agent_selection, copy.deepcopy(env.last()[0])))\n",
}
OVERWRITE = """\
def overwrite(value):
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value[...] = value == 0
    for key, item in value.items() if isinstance(value, dict) else ():
        if key != "action_mask":
            overwrite(item)
    for item in value if isinstance(value, (list, tuple)) else ():
        overwrite(item)
"""
"""Defines `overwrite` for a snippet: as that of `run.handed`, and leaves action masks alone."""
OVERWRITE_MASKS = """\
def overwrite_masks(value):
    for key, item in value.items() if isinstance(value, dict) else ():
        (overwrite if key == "action_mask" else overwrite_masks)(item)
"""
"""Defines `overwrite_masks` for a snippet, beside `OVERWRITE`."""


def story_proof(
    api: str,
    meddling: str,
    *,
    idle: str = "pass",
    first: str = "",
    infos: bool = True,
    early: bool = False,
    is_next: bool = False,
) -> Proof:
    """Raises while the same actions go another way once `meddling` stands between the steps.

    Args:
        api: `aec` or `parallel`.
        meddling: Python over `env` and (Parallel) `out`, what reset or step returned.
        idle: what stands there in the play that it is compared with.
        first: lines before all others.
        infos: in an AEC environment, whether infos are compared too.
        early: in an AEC environment, meddle before `last()` too, not only before `step`.
        is_next: what the next reset gives, without a seed, is compared too.
    """
    told = _PARALLEL
    if api == "aec":
        before = "        meddle(env, None)\n" if early else ""
        told = _AEC.replace("{part}", "" if infos else "[:4]").replace("{early}", before)
    told = told.replace("{next}", _NEXT[api] if is_next else "")
    lines = (
        f"{first}{told}\n"
        f"def meddle(env, out):\n{_indented(meddling)}\n"
        f"def leave(env, out):\n{_indented(idle)}\n"
        "np.testing.assert_equal(story(meddle), story(leave))"
    )
    return Proof(lines, plays=False, imports=("copy",))


def _indented(lines: str) -> str:
    return "".join(f"    {line}\n" for line in lines.splitlines())


def parting_words(parting: Divergence) -> str:
    """In words where a play went another way, with both values where they are short."""
    field = WORDS.get(parting.field, parting.field)
    whose = "" if parting.agent is None else f" of {parting.agent!r}"
    one, other = shown(parting.recorded), shown(parting.replayed)
    is_short = len(one) + len(other) < 60 and "\n" not in one + other and one != other
    values = f" is {other} in place of {one}" if is_short else " is another"
    return f"at turn {parting.turn} the {field}{whose}{values}"


def crossings_of(parting: Divergence) -> int | None:
    """How many steps must have been made until the parting can be seen."""
    return None if parting.turn is None else parting.turn + (parting.field in LATE)
