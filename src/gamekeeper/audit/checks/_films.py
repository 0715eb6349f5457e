"""What checks of rendering share: the lines of a proof that film a play."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import indent
from typing import Any

from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


def nothing_to_film(contract: Contract, evidence: Gathered) -> str | None:
    """Why there are no frames to judge; None where there are, or where nobody could look."""
    modes = [fact.value for fact in evidence.facts("render", "mode")]
    if not evidence.looks.get("render") or any(mode["taken"] for mode in modes):
        return None
    if modes:
        return "its factory takes no render_mode"
    return "it declares no render mode but perhaps 'human', which needs a screen"


def filmed(api: str, options: Mapping[str, Any], lines: str) -> Proof:
    """A proof that renders at every turn of the play into `frames`, and ends with `lines`."""
    play = (
        "env = make()\nenv.reset(seed=SEED)\nframes = [env.render()]\n"
        f"for action in ACTIONS:\n{_step(api)}    frames.append(env.render())\n"
    )
    return Proof(play + lines, plays=False, options=options)


def told(api: str) -> str:
    """Lines of a function `course(env, film)`: all that a play gives, filmed or not."""
    body = (
        "told = [env.reset(seed=SEED)]\n"
        "for action in ACTIONS:\n"
        "    if film:\n        env.render()\n"
        + (
            "    told.append(env.step(action))\n"
            if api == "parallel"
            else "    told.append(env.last())\n    env.step(action)\n"
        )
        + (
            ""
            if api == "parallel"
            else "if film:\n    env.render()\nif env.agents:\n    told.append(env.last())\n"
        )
        + "return repr(told)\n"
    )
    head = "np.set_printoptions(threshold=10**9, precision=17)\n"
    return f"{head}def course(env, film):\n{indent(body, '    ')}"


def _step(api: str) -> str:
    return (
        "    env.step(action)\n" if api == "parallel" else "    env.last()\n    env.step(action)\n"
    )
