"""Agents that are no values, such as objects that each reset makes anew: known by their places."""

from collections.abc import Callable
from typing import Any, Final

from gamekeeper.auditing.holds import Hold, with_methods
from gamekeeper.checks.literal import is_value
from gamekeeper.interface.opening import Opened


def are_found_by_place(opened: Opened) -> bool:
    """Tells whether actions of an earlier episode can't name the agents of a later one."""
    if opened.api != "parallel" or opened.make is None:
        return False
    try:
        agents = getattr(opened.env, "possible_agents", None)
        return not all(map(is_value, _first_agents(opened) if agents is None else agents))
    except (Exception, SystemExit):  # what is broken is for the probes to tell
        return False


def _first_agents(opened: Opened) -> list[Any]:
    env = opened.make() if opened.make is not None else opened.env
    try:
        env.reset()
        return list(env.agents)
    finally:
        env.close()


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
