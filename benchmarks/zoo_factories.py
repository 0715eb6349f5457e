"""Factories for environments of the zoo that take more than names and numbers to build."""

from __future__ import annotations

from typing import Any


def laser_learning(level: int = 6) -> Any:
    """A level of the Laser Learning Environment."""
    import lle

    return lle.level(level).build()


def highway(cars: int = 2) -> Any:
    """Several cars of ours on the highway: tuples of actions and observations."""
    import gymnasium
    import highway_env

    highway_env.register_highway_envs() if hasattr(highway_env, "register_highway_envs") else None
    each = {"type": "Kinematics", "vehicles_count": 5}
    config = {
        "controlled_vehicles": cars,
        "vehicles_count": 10,
        "duration": 30,
        "action": {"type": "MultiAgentAction", "action_config": {"type": "DiscreteMetaAction"}},
        "observation": {"type": "MultiAgentObservation", "observation_config": each},
    }
    return gymnasium.make("highway-fast-v0", config=config, disable_env_checker=True)


def cogrid_overcooked(layout: str = "Overcooked-CrampedRoom-V0") -> Any:
    """Two cooks of CoGrid's."""
    from cogrid.envs import registry

    return registry.make(layout)


def generals() -> Any:
    """Two players of Generals.io; the roster carries names alone, the policies are ours."""
    from generals.agents import RandomAgent
    from generals.envs import PettingZooGenerals

    players = {name: RandomAgent(id=name) for name in ("red", "blue")}
    return PettingZooGenerals(agents=players)


def football() -> Any:
    """Frondori's football of two."""
    from frondori_football import FootballEnv

    return FootballEnv()
