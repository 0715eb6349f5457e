"""What checks share that read what the probe `copies` saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.proof import Proof

MADE = {"deepcopy": "copy.deepcopy(env)", "pickle": "pickle.loads(pickle.dumps(env))"}
_PARALLEL = """\
def go(env, paper):
    told = []
    for actions in copy.deepcopy(paper):
        told.append(copy.deepcopy(env.step(actions)))
        told.append(state(env))
    return told
"""
_AEC = """\
def go(env, paper):
    told = []
    for action in copy.deepcopy(paper):
        told.append((env.agent_selection, copy.deepcopy(env.last())))
        env.step(action)
        told.append((dict(env.rewards), state(env)))
    return told
"""
_STATE = """\
def state(env):
    try:
        return copy.deepcopy(env.state())
    except (NotImplementedError, AttributeError):
        return None
"""


def copied(evidence: Gathered, way: str, who: str) -> Iterator[Occasion]:
    """An occasion for every copy made in this way; `who`: `copy` or `original`, who is compared."""
    for fact in evidence.facts("copies", "copied"):
        if fact.where.field != way or (who == "copy" and fact.value["refused"]):
            continue
        if who == "original" and fact.value["refused"] and fact.value[who] is None:
            continue
        wrong = fact.value[who]
        yield Occasion(
            replace(fact.where, turn=None if wrong is None else fact.where.turn), wrong is None,
            "it goes on like a play of which no copy was made",
            "it does" if wrong is None else wrong,
            proof=_proof(evidence.api, way, who, fact.value["at"]),
        )  # fmt: skip


def refused(way: str) -> Callable[[Contract, Gathered], str | None]:
    """Why there is nothing to judge: nobody promises that an environment can be copied."""

    def against(contract: Contract, evidence: Gathered) -> str | None:
        reasons = [f.value["refused"] for f in evidence.facts("copies") if f.where.field == way]
        if reasons and all(reasons):
            return f"it doesn't let itself be copied, which nobody promises ({reasons[0]:.120})"
        return None

    return against


def _proof(api: str, way: str, who: str, at: int) -> Proof:
    play = _PARALLEL if api == "parallel" else _AEC
    lines = (
        f"{_STATE}{play}\n"
        f"at = {at}\n"
        "env, alone = make(), make()\n"
        "for each in (env, alone):\n"
        "    each.reset(seed=SEED)\n"
        "    go(each, ACTIONS[:at])\n"
        f"twin = {MADE[way]}\n"
    )
    if who == "copy":
        lines += "np.testing.assert_equal(go(twin, ACTIONS[at:]), go(alone, ACTIONS[at:]))"
    else:
        lines += (
            "go(twin, ACTIONS[at:])\n"
            "np.testing.assert_equal(go(env, ACTIONS[at:]), go(alone, ACTIONS[at:]))"
        )
    return Proof(lines, plays=False, imports=("copy", "pickle"))
