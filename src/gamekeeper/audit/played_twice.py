"""Occasions about one play that was played twice, and programs that play it twice. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from gamekeeper.audit.literal import literal
from gamekeeper.core.contract import Contract
from gamekeeper.core.difference import shown_pair
from gamekeeper.core.divergence import Divergence
from gamekeeper.core.gathered import Gathered, Twin
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.proof import Proof
from gamekeeper.core.where import PAID_BY, Where

FIELD: Final = "divergence"
"""Names the place where two plays part, whatever it is in that differs."""
SAME: Final = "the same play"

MOST_SHOWN: Final = 80
"""Characters of an array or a dictionary."""

_PAID: Final = PAID_BY | {"reward", "action"}


def settled_by_seed(contract: Contract, evidence: Gathered) -> str | None:
    """Why nothing is to be judged where a seed needn't settle the play."""
    if contract.seeds.deterministic is False:
        return "the contract declares that a seed doesn't settle the play"
    return None


def parted(twin: Twin, proof: Proof, *, expected: str = SAME) -> Iterator[Occasion]:
    """One look at a twin: did it part from its base, and from nothing else's doing?"""
    divergence = twin.divergence
    if divergence is not None and divergence.field == "odd":
        return  # equal values, one of which came before its space could be asked for
    if divergence is None:
        yield Occasion(whole(twin), True, expected, expected)
    elif twin.noise is None:
        yield Occasion(place(twin, divergence), False, expected, told(divergence), proof)


def whole(twin: Twin) -> Where:
    """The play of a twin as a whole."""
    return twin.base.at(None, None, FIELD)


def place(twin: Twin, divergence: Divergence) -> Where:
    """The place of a divergence, its turn counted by the steps that it takes to see it."""
    turn = divergence.turn
    if turn is not None:
        turn += divergence.field.partition(".")[0] in _PAID
    return twin.base.at(turn, divergence.agent, FIELD)


def told(divergence: Divergence) -> str:
    """Both values in one line."""
    key = divergence.field
    if divergence.agent is not None:
        key += f"[{divergence.agent!r}]"
    turn = "" if divergence.turn is None else f" at turn {divergence.turn}"
    one, two, at = _unlike(divergence.recorded, divergence.replayed)
    return f"{key}{at}{turn} is {two}, where it was {one}"


def _unlike(one: Any, two: Any) -> tuple[str, str, str]:
    """Both values in words; of arrays the first element that differs, with its place."""
    both = isinstance(one, np.ndarray) and isinstance(two, np.ndarray)
    if both and one.shape == two.shape and one.ndim:
        places = np.argwhere(~((one == two) | ((one != one) & (two != two))))
        if len(places):
            at = tuple(places[0].tolist())
            return literal(one[at]), literal(two[at]), str(list(at))
    shown = shown_pair(one, two)
    return _brief(one, shown[0]), _brief(two, shown[1]), ""


def _brief(value: Any, shown: str) -> str:
    if value is None:
        return "missing"
    return literal(value)[:MOST_SHOWN] if isinstance(value, np.ndarray | dict) else shown


def told_of(contract: Contract, twin: Twin | None = None) -> frozenset[str]:
    """What a program tells of a play beside what agents are given: `infos`, `state`."""
    infos = set() if contract.volatile_infos() else {"infos"}
    has_state = twin is not None and twin.base.states is not None
    return frozenset(infos | ({"state"} if has_state else set()))


def program(
    api: str,
    *lines: str,
    tells: frozenset[str] = frozenset({"infos"}),
    imports: tuple[str, ...] = (),
    reset: str = "env.reset(seed=seed)",
) -> Proof:
    """A program whose `play(env, seed=SEED, between=...)` tells all that was seen, as text.

    An error of the environment is told like all else, and ends the play.

    Args:
        lines: what is done with it.
        tells: `infos` (not where some of them may differ), `state`.
        imports: modules that the lines need.
        reset: how each play begins; without an argument it is another one than with None.
    """
    course = _parallel(reset, tells) if api == "parallel" else _aec(reset, tells)
    told = [
        'np.set_printoptions(threshold=10**9, floatmode="unique")',
        "def play(env, seed=SEED, between=lambda: None):",
        "    seen = []",
        "    try:",
        *(f"    {line}" for line in course),
        "    except Exception as error:",
        "        seen.append(error)",
        "    return repr(seen)",
        "",
    ]
    return Proof("\n".join([*told, *lines]), plays=False, imports=imports)


def _parallel(reset: str, tells: frozenset[str]) -> list[str]:
    cuts = ("", "") if "infos" in tells else ("[:1]", "[:4]")
    state = ", env.state()" if "state" in tells else ""
    return [
        "    between()",
        f"    seen.append(({reset}{cuts[0]}{state}))",
        "    for actions in ACTIONS:",
        "        between()",
        f"        seen.append((env.step(actions){cuts[1]}{state}))",
    ]


def _aec(reset: str, tells: frozenset[str]) -> list[str]:
    last = "env.last()" if "infos" in tells else "env.last()[:4]"
    look = f"env.agents and (env.agent_selection, {last}), dict(env.rewards)"
    if "state" in tells:
        look += ", env.state()"
    return [
        "    between()",
        f"    {reset}",
        f"    seen.append(({look}))",
        "    for action in ACTIONS:",
        "        between()",
        "        env.step(action)",
        f"        seen.append(({look}))",
    ]
