"""Agents that are no values, such as objects that each reset makes anew: known by their places."""

import copy
from collections.abc import Callable
from typing import Any, Final

from gamekeeper.auditing.holds import Hold, with_methods
from gamekeeper.interface.opening import Opened


def is_value(agent: Any) -> bool:
    """Tells whether an agent equals a copy of it, as names do; where none can be made it may."""
    try:
        return agent.__class__ is str or bool(copy.deepcopy(agent) == agent)
    except Exception:  # whatever foreign code raises, nothing is known against it
        return True


def are_found_by_place(opened: Opened) -> bool:
    """Tells whether actions of an earlier episode can't name the agents of a later one."""
    if opened.api != "parallel" or opened.make is None:
        return False
    agents = getattr(opened.env, "possible_agents", None)
    if agents is None:
        env = opened.make()
        try:
            env.reset()
            agents = list(env.agents)
        except Exception:  # broken resets are for the probes to tell
            return False
        finally:
            env.close()
    return not all(map(is_value, agents))


def actions_by_place(make: Callable[[], Any]) -> Callable[[], Any]:
    """Hands actions to agents by their place in `agents`, where they name none of these."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def step(self: Any, actions: Any) -> Any:
            agents = list(self.agents)
            if len(agents) == len(actions) and not any(agent in actions for agent in agents):
                actions = dict(zip(agents, actions.values(), strict=True))
            return cls.step(self, actions)

        return {"step": step}

    return with_methods(make, methods)


PLACES: Final = Hold("actions handed to agents by their place in `agents`", actions_by_place)
