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


def pymapf_parallel(agents: int = 3, width: int = 6, height: int = 6) -> Any:
    """Path finding by PyMAPF: obstacles drawn at random, through its PettingZoo face."""
    from pymapf.rl import MAPFEnv

    return MAPFEnv("random_obstacles", n_agents=agents, width=width, height=height).to_pettingzoo()


def mosaic_soccer(render_mode: str | None = None) -> Any:
    """Soccer of two against two by Mosaic's grids, through its Parallel face."""
    from mosaic_multigrid.envs import SoccerGame4HIndAgObsEnv16x11N2
    from mosaic_multigrid.pettingzoo import to_pettingzoo_env

    return to_pettingzoo_env(SoccerGame4HIndAgObsEnv16x11N2)(render_mode=render_mode)


def mosaic_soccer_aec(render_mode: str | None = None) -> Any:
    """The same through its AEC face."""
    from mosaic_multigrid.envs import SoccerGame4HIndAgObsEnv16x11N2
    from mosaic_multigrid.pettingzoo import to_pettingzoo_aec_env

    return to_pettingzoo_aec_env(SoccerGame4HIndAgObsEnv16x11N2)(render_mode=render_mode)


def sustainable_foraging(render_mode: str | None = None) -> Any:
    """Foraging of two that have to leave something, by turns."""
    from sustainable_foraging.foraging.aecEnvironment import ForagingEnv

    return ForagingEnv(2, (6, 6), 3, 6, 50, render_mode=render_mode)
