"""Proofs of what a life cycle came to: lines that raise while the fault is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.audit.literal import literal
from gamekeeper.core.proof import Proof

MIDST: Final = "if not env.agents:\n    env.reset(seed=SEED)\n    env.step(ACTIONS[0])\n"
"""Where the story ends its episode, another one begins, to be reset in its midst."""
IGNORED: Final = {
    "parallel": Proof(
        f"{MIDST}fresh, _ = make().reset(seed=SEED)\n"
        "again, _ = env.reset(seed=SEED)\n"
        "np.testing.assert_equal(again, fresh)"
    ),
    "aec": Proof(
        f"{MIDST}fresh = make()\n"
        "fresh.reset(seed=SEED)\n"
        "env.reset(seed=SEED)\n"
        "np.testing.assert_equal(env.last()[0], fresh.last()[0])"
    ),
}
"""A reset gives what a fresh instance's reset gives."""

ITERATES: Final = Proof(
    """\
env = make()
env.reset(seed=SEED)
names = []
for agent, action in zip(env.agent_iter(len(ACTIONS)), ACTIONS):
    assert agent == env.agent_selection, (agent, env.agent_selection)
    names.append(agent)
    env.last()
    env.step(action)
assert len(names) == len(ACTIONS), names""",
    plays=False,
)
"""`agent_iter` names who is to act, as often as it is asked to."""


def given(api: str, actions: Mapping[Any, Any]) -> str:
    """The argument of a step, as Python."""
    return literal(dict(actions) if api == "parallel" else next(iter(actions.values()), None))


def goes_on(api: str, actions: Mapping[Any, Any], *, plays: bool) -> Proof:
    """A step where none should be raises, or gives nothing."""
    start = "" if plays else "env = make()\n"
    if api == "parallel":
        lines = (
            f"try:\n    out = env.step({given(api, actions)})\n"
            "except Exception:\n    out = ()  # refused\nassert not any(out), out"
        )
    else:
        lines = (
            f"try:\n    env.step({given(api, actions)})\n"
            "except Exception:\n    was_refused = True\n"
            "else:\n    was_refused = not env.agents\nassert was_refused, env.agents"
        )
    return Proof(start + lines, plays=plays)


def refuses(action: Any) -> Proof:
    """A dead agent's action raises."""
    return Proof(
        f"try:\n    env.step({literal(action)})\nexcept Exception:\n    was_refused = True\n"
        "else:\n    was_refused = False\nassert was_refused"
    )


def begins(api: str, resets: int, turns: Sequence[Mapping[Any, Any]]) -> Proof:
    """After so many resets there are agents, and the turns can be played."""
    look = "" if api == "parallel" else "env.last()\n"
    steps = "".join(f"{look}env.step({given(api, actions)})\n" for actions in turns)
    return Proof("env.reset(seed=SEED)\n" * resets + "assert env.agents\n" + steps)
