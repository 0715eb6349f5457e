"""What checks share that read what the probe `kept` saw."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.proof import Proof

PLACES = {"observations": 0, "rewards": 1, "terminations": 2, "truncations": 3, "infos": -1}
"""Where a part stands in what a Parallel environment's step returns."""


def kept(evidence: Gathered, *fields: str) -> Iterator[Occasion]:
    """An occasion for every look at things of these kinds that were handed out earlier."""
    for fact in evidence.facts("kept", "kept"):
        if fact.where.field not in fields:
            continue
        changed = fact.value["changed"]
        fine = fact.value["looks"] - (changed is not None)
        for _ in range(fine):
            yield Occasion(fact.where, True)
        if changed is not None:
            yield Occasion(
                fact.where, False, f"what was handed out at turn {changed['given']} stays as it is",
                f"it has changed by turn {changed['seen']}",
                proof=_kept_proof(evidence.api, fact.where.field),
            )  # fmt: skip


def without_state(contract: Contract, evidence: Gathered) -> str | None:
    """Why nothing that `state()` gives can change: there is none, or it gives plain values."""
    fields = {fact.where.field for fact in evidence.facts("kept", "kept")}
    return "it has no state() that hands out arrays" if fields and "state" not in fields else None


def apart(evidence: Gathered, field: str) -> Iterator[Occasion]:
    """An occasion for every pair of agents whose memory was compared."""
    for fact in evidence.facts("kept", "shared"):
        if fact.where.field != field:
            continue
        pair = fact.value["pair"]
        for _ in range(fact.value["looks"] - (pair is not None)):
            yield Occasion(fact.where, True)
        if pair is not None:
            one, other = pair
            yield Occasion(
                fact.where, False, "memory of its own for each agent",
                f"{one!r} and {other!r} were given the same",
                proof=_apart_proof(evidence.api, field, one, other),
            )  # fmt: skip


def _kept_proof(api: str, field: str) -> Proof:
    """Plays, keeps everything beside a copy, and compares at the end."""
    value = "env.state()" if field == "state" else f"out[{PLACES[field]}]"
    if api == "parallel":
        first = value if field in ("observations", "infos", "state") else "{}"
        lines = (
            "env = make()\n"
            "out = env.reset(seed=SEED)\n"
            f"value = {first}\n"
            "given = [(value, copy.deepcopy(value))]\n"
            "for actions in ACTIONS:\n"
            "    out = env.step(actions)\n"
            f"    value = {value}\n"
            "    given.append((value, copy.deepcopy(value)))\n"
        )
    else:
        lines = (
            "env = make()\n"
            "env.reset(seed=SEED)\n"
            "given = []\n"
            "for turn in range(len(ACTIONS) + 1):\n"
            "    if not env.agents:\n"
            "        break\n"
            "    out = env.last()\n"
            f"    value = {value}\n"
            "    given.append((value, copy.deepcopy(value)))\n"
            "    if turn < len(ACTIONS):\n"
            "        env.step(ACTIONS[turn])\n"
        )
    lines += "for value, copied in given:\n    np.testing.assert_equal(value, copied)"
    return Proof(lines, plays=False, imports=("copy",))


def _apart_proof(api: str, field: str, one: object, other: object) -> str:
    """Changes what one was given, and looks at what the other was given."""
    if api == "parallel":
        mine, theirs = f"{field}[{one!r}]", f"{field}[{other!r}]"
    elif field == "infos":
        mine, theirs = f"env.infos[{one!r}]", f"env.infos[{other!r}]"
    else:
        mine, theirs = f"env.observe({one!r})", f"env.observe({other!r})"
    return (
        "def arrays(value):\n"
        "    items = value.values() if isinstance(value, dict) else value\n"
        "    if isinstance(value, np.ndarray):\n"
        "        return [value]\n"
        "    if isinstance(value, (dict, list, tuple)):\n"
        "        return [array for item in items for array in arrays(item)]\n"
        "    return []\n"
        f"mine, theirs = {mine}, {theirs}\n"
        "assert mine is not theirs\n"
        "assert not any(np.shares_memory(a, b) for a in arrays(mine) for b in arrays(theirs))"
    )
