"""How a reader sees an illegal action again. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gamekeeper.audit.literal import literal
from gamekeeper.core.proof import Proof


def proof(api: str, turn: int | None, value: Mapping[str, Any], then: str) -> Proof:
    """Lines that play up to the illegal action, take it, and go on with `then`.

    Args:
        turn: the turn of the illegal action.
        value: of a fact `illegal`.
        then: lines that raise; `out` is what the step gave, `error` what it raised.
    """
    actions = value["action"]
    handed = literal(dict(actions) if api == "parallel" else next(iter(actions.values()), None))
    return Proof(
        "env = make()\n"
        "env.reset(seed=SEED)\n"
        f"for actions in ACTIONS[:{turn}]:\n"
        "    env.step(actions)\n"
        "out = error = None\n"
        "try:\n"
        f"    out = env.step({handed})\n"
        "except Exception as raised:\n"
        "    error = raised\n"
        f"{then}",
        plays=False,
    )
