"""Factories for environments of the zoo that take more than names and numbers to build."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

from zoo_repositories import inner_module, inside_repository, of_repository, older


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
    """Path finding by PyMAPF: obstacles drawn at random, through its PettingZoo environment."""
    from pymapf.rl import MAPFEnv

    return MAPFEnv("random_obstacles", n_agents=agents, width=width, height=height).to_pettingzoo()


def mosaic_soccer(render_mode: str | None = None) -> Any:
    """Soccer of two against two by Mosaic's grids, through its Parallel API."""
    from mosaic_multigrid.envs import SoccerGame4HIndAgObsEnv16x11N2
    from mosaic_multigrid.pettingzoo import to_pettingzoo_env

    return to_pettingzoo_env(SoccerGame4HIndAgObsEnv16x11N2)(render_mode=render_mode)


def mosaic_soccer_aec(render_mode: str | None = None) -> Any:
    """The same through its AEC API."""
    from mosaic_multigrid.envs import SoccerGame4HIndAgObsEnv16x11N2
    from mosaic_multigrid.pettingzoo import to_pettingzoo_aec_env

    return to_pettingzoo_aec_env(SoccerGame4HIndAgObsEnv16x11N2)(render_mode=render_mode)


def sustainable_foraging(render_mode: str | None = None) -> Any:
    """Foraging of two that have to leave something, by turns."""
    from sustainable_foraging.foraging.aecEnvironment import ForagingEnv

    return ForagingEnv(2, (6, 6), 3, 6, 50, render_mode=render_mode)


# Packages of the index whose environments are built from parts.


def multigrid(name: str, **kwargs: Any) -> Any:
    """A multigrid environment through its Parallel interface."""
    import gymnasium
    from multigrid.pettingzoo import PettingZooWrapper

    importlib.import_module("multigrid.envs")  # registers them
    return PettingZooWrapper(gymnasium.make(name, **kwargs).unwrapped)


def mettagrid_rooms(agents: int = 4) -> Any:
    """A room of MettaGrid's with its default rules."""
    from mettagrid.config.mettagrid_config import MettaGridConfig
    from mettagrid.envs.pettingzoo_env import MettaGridPettingZooEnv
    from mettagrid.simulator import Simulator

    config = MettaGridConfig.EmptyRoom(num_agents=agents)
    config.game.max_steps = 100
    return MettaGridPettingZooEnv(Simulator(), config)


def pymarl_overcooked(layout: str = "cramped_room", horizon: int = 60) -> Any:
    """The Overcooked that pymarlzooplus carries, through its Parallel class."""
    from pymarlzooplus.envs.overcooked_ai.src.overcooked_ai_py.agents.agent import (
        AgentPair,
        StayAgent,
    )
    from pymarlzooplus.envs.overcooked_ai.src.overcooked_ai_py.mdp.overcooked_env import (
        OvercookedEnv,
        OvercookedEnvPettingZoo,
    )
    from pymarlzooplus.envs.overcooked_ai.src.overcooked_ai_py.mdp.overcooked_mdp import (
        OvercookedGridworld,
    )

    base = OvercookedEnv.from_mdp(OvercookedGridworld.from_layout_name(layout), horizon=horizon)

    class Featurized(StayAgent):
        def featurize(self, state: Any) -> Any:
            return base.featurize_state_mdp(state)

    return OvercookedEnvPettingZoo(base, AgentPair(Featurized(), Featurized()))


def sumo(parallel: bool = True) -> Any:
    """A junction of SUMO's that sumo-rl carries."""
    import sumo as simulator

    os.environ.setdefault("SUMO_HOME", simulator.SUMO_HOME)
    found = importlib.util.find_spec("sumo_rl")
    assert found is not None
    assert found.origin is not None
    folder = Path(found.origin).parent / "nets" / "4x4-Lucas"
    files = {"net_file": "4x4.net.xml", "route_file": "4x4c1c2c1c2.rou.xml"}
    return older(
        "sumo_rl",
        "parallel_env" if parallel else "env",
        **{key: str(folder / name) for key, name in files.items()},
        num_seconds=300,
        use_gui=False,
    )


# Packages made for older interfaces: `dones` in place of two flags, spaces of the old Gym.


def with_dones(old: type) -> type:
    """A class of before PettingZoo 1.22, `dones` and all, in the shape of today's AECEnv."""

    class Today(old):  # type: ignore[misc, valid-type]
        @property
        def dones(self) -> dict[Any, bool]:
            return self.terminations

        @dones.setter
        def dones(self, ended: dict[Any, bool]) -> None:
            self.terminations = ended
            self.truncations = dict.fromkeys(ended, False)

        def reset(self, seed: int | None = None, options: Any = None) -> None:
            if seed is not None:
                self.seed(seed)
            super().reset()

        def _dones_step_first(self) -> Any:
            return self._deads_step_first()

        def _was_done_step(self, action: Any) -> None:
            self._was_dead_step(action)

    return Today


def skyjo(players: int = 3) -> Any:
    """The card game Skyjo of rlskyjo, made for PettingZoo 1.14 and the old Gym's spaces."""
    import gymnasium

    sys.modules.setdefault("gym", gymnasium)
    from rlskyjo.environment.skyjo_env import DEFAULT_CONFIG, SimpleSkyjoEnv

    return with_dones(SimpleSkyjoEnv)(**{**DEFAULT_CONFIG, "num_players": players})


# Public repositories.


def crazyrl(task: str, agents: int = 3) -> Any:
    """A task of CrazyRL in its own simulation."""
    import numpy as np

    ids = np.arange(agents)
    start = np.array([[0, 0, 1], [1, 1, 1], [0, 1, 1], [2, 2, 1]])[:agents]
    target = np.array([[1, 1, 2.5]])
    wanted: dict[str, dict[str, Any]] = {
        "hover": {},
        "circle": {},
        "surround": {"target_location": target},
        "catch": {"init_target_location": target, "target_speed": 0.1},
        "escort": {"init_target_location": target, "final_target_location": target * [-1, -1, 1]},
    }
    return of_repository(
        "ffelten+CrazyRL",
        f"crazy_rl.multi_agent.numpy.{task}.{task}",
        task.capitalize(),
        drone_ids=ids,
        init_flying_pos=start,
        **wanted[task],
    )


def flocking() -> Any:
    """Boids of Multi-Agent-Flocking, with mpe2 in the place of PettingZoo's mpe that it imports."""
    import mpe2
    import mpe2._mpe_utils.simple_env

    sys.modules["pettingzoo.mpe"] = mpe2
    sys.modules["pettingzoo.mpe._mpe_utils"] = mpe2._mpe_utils
    for name in ("simple_env", "core", "scenario"):
        module = importlib.import_module(f"mpe2._mpe_utils.{name}")
        sys.modules[f"pettingzoo.mpe._mpe_utils.{name}"] = module
    import yaml

    where = Path(os.environ["ZOO_REPOSITORIES"], "NitishNaineni+Multi-Agent-Flocking")
    config = yaml.safe_load((where / "config" / "env.yml").read_text())
    return of_repository(where.name, "boids", "parallel_env", config=config)


def tft(players: int = 4) -> Any:
    """Teamfight Tactics of TFTMuZeroAgent."""
    made = of_repository(
        "silverlight6+TFTMuZeroAgent", "Simulator.tft_simulator", "TFTConfig", num_players=players
    )
    return of_repository(
        "silverlight6+TFTMuZeroAgent", "Simulator.tft_simulator", "parallel_env", config=made
    )


def cooking(level: str = "coop_test", agents: int = 2) -> Any:
    """A kitchen of cooking_zoo."""
    return of_repository(
        "DavidRother+cooking_zoo",
        "cooking_zoo.environment.cooking_env",
        "parallel_env",
        level=level,
        meta_file="example",
        num_agents=agents,
        max_steps=100,
        recipes=["TomatoLettuceSalad", "CarrotBanana"][:agents],
        obs_spaces=["feature_vector"] * agents,
    )


def wolfpack(predators: int = 2) -> Any:
    """Wolfpack of the same author, made for the old Gym's spaces."""
    import gymnasium

    sys.modules.setdefault("gym", gymnasium)
    return of_repository(
        "DavidRother+pettingzoo_wolfpack",
        "pettingzoo_wolfpack.wolfpack.wolfpack_zoo_env",
        "parallel_env",
        env_name="wolfpack",
        ep_max_timesteps=50,
        n_predator=predators,
        prefix="",
        seed=1,
    )


def matrix_game(game: str) -> Any:
    """A matrix game of pettingzoo-dilemmas."""
    module = f"pettingzoo_dilemmas.{game}.{game}_v0"
    return of_repository("mrochk+pettingzoo-dilemmas", module, "env", nrounds=10)


def network_game(name: str, agents: int = 4, **kwargs: Any) -> Any:
    """A game of cognac's on a ring, each agent influenced by the two beside it."""
    import cognac.env
    import numpy as np

    ring = np.zeros((agents, agents))
    for agent in range(agents):
        ring[agent, (agent + 1) % agents] = ring[agent, (agent - 1) % agents] = 0.5
    return getattr(cognac.env, name)(adjacency_matrix=ring, **kwargs)


def mosaic(name: str) -> Any:
    """An environment of Mosaic's grids through its Parallel interface."""
    import mosaic_multigrid.envs
    from mosaic_multigrid.pettingzoo import to_pettingzoo_env

    return to_pettingzoo_env(getattr(mosaic_multigrid.envs, name))()


def battlesnake() -> Any:
    """Two snakes of pypzbattlesnake, without a window."""
    from pypzbattlesnake import BattleSnake

    return BattleSnake(teams_count=2, team_snakes_count=1, render_mode=None)


def swarm_of_tanks(agents: int = 4) -> Any:
    """Tanks that look for targets, without a window."""
    config = of_repository(
        "titancoder12+swarm_robotic_rl", "env.config", "SwarmConfig", n_agents=agents, max_steps=100
    )
    return of_repository(
        "titancoder12+swarm_robotic_rl", "env.swarm_env", "SwarmEnv", cfg=config, headless=True
    )


def supply_chain() -> Any:
    """A supply chain of three, with the configuration of its own tests."""
    where = "BigChunggus51+shock_chain"
    read = inside_repository(where, "src.utils.config_loader", "load_all_configs")
    return of_repository(
        where,
        "src.environment.multi_agent_env",
        "MultiAgentSupplyChainEnv",
        env_config=read["environment"],
        reward_config=read["reward"],
        topology_config=read["topology"],
        shock_config=read["shocks"],
    )


def targets_without_window() -> Any:
    """Agents that fly to targets, without a window."""
    return of_repository(
        "jp013718+marl_example", "environment.envs.marl_env", "MarlEnvironment", render_mode=None
    )


def combat() -> Any:
    """Antibody and antigen, with the defaults of its own command line."""
    defaults = {"seed": 1, "max_episode_len": 25, "num_agents": 2, "num_variants": 2, "seq_len": 5}
    args = argparse.Namespace(**defaults)
    return of_repository(
        "FahsaiNak+CombatRL", "environment", "CombatActionMaskedEnvironment", args=args
    )


def inventory() -> Any:
    """Three warehouses that order, by one of its configurations."""
    where = "Jakoebly+marl-sc"
    path = "config_files/environments/env_symmetric_3WH2SKU.yaml"
    read = inside_repository(where, "src.config.loader", "load_environment_config", path=path)
    return of_repository(
        where, "src.environment.envs.multi_env", "InventoryEnvironment", env_config=read
    )


def manufacturing() -> Any:
    """Job shop and maintenance, with the configuration of its first phase."""
    import yaml

    where = "Zeleckto+MARL_MaintOptimization"
    files = Path(os.environ["ZOO_REPOSITORIES"], where, "configs")
    names = "base.yaml", "phase1.yaml"
    base, phase = (yaml.safe_load((files / name).read_text(encoding="utf-8")) for name in names)
    return of_repository(
        where, "environments.mfg_env", "ManufacturingEnv", config={**base, **(phase or {})}
    )


def coverage() -> Any:
    """Base stations on vehicles and drones, with the configuration of its own training."""
    where = "mahdimahdieh+marl-mlbs"
    paths = {"config_path": "config/simulation_config.json", "graph_path": "config/graph_map.json"}
    read = inside_repository(where, "main", "bootstrap_environment", **paths)
    return of_repository(where, "rl.envs.pettingzoo_env", "CoverageParallelEnv", config=read[0])


def racing() -> Any:
    """Three cars on the track of its own tests."""
    where = "Mibrahim2003+F1-RL"
    read = inner_module(where, "src", "f1rl.utils.config").load_config
    config = read("default", overrides=["track_id=red_bull_ring"], config_root=Path("configs"))
    racing_env = inner_module(where, "src", "f1rl.env.multi_agent").RacingParallelEnv
    return racing_env(config, n_agents=3)


def batteries() -> Any:
    """Five batteries, for a day at a time at the prices that its training reads."""
    import csv

    where = "khaled-sawaid+battery-rl-env"
    path = Path(os.environ["ZOO_REPOSITORIES"], where, "datasets/energy_prices_2024_france.csv")
    column = "Day-ahead Price (EUR/MWh)"
    with path.open() as file:
        prices = [float(row[column]) / 1000 for row in csv.DictReader(file) if row[column]]
    return of_repository(where, "envs.multi_agent", "BatteryParallelEnv", price_series=prices)


def drone_swarm() -> Any:
    """Drones and targets of its own scenario."""
    setup = inner_module("ApartsinProjects+ZKDroneSwarm", "", "experiments.env_setup")
    return setup.build_env_and_configs(setup.load_config("config/scenario.json"))[0]


def arena() -> Any:
    """Organisms that fight, with the configuration of that experiment."""
    import yaml

    where = "sparktron+MLenvironment"
    arena_module = inner_module(where, "src", "rl_framework.envs.organisms.arena_parallel")
    path = Path("src/rl_framework/configs/experiments/organisms_fight_arena.yaml")
    return arena_module.OrganismArenaParallelEnv(yaml.safe_load(path.read_text())["environment"])


def cards() -> Any:
    """Decks of forty plain followers, as in its own tests: its data base of cards isn't there."""
    where = "jacklee12312+SWB-RL"
    card = inner_module(where, "", "swb.db.repository").CardDefinition
    same = {"card_set_id": 10000, "class_id": 1, "class_name": "", "card_type": "随从"}
    same |= {"keywords": frozenset(), "support_level": "basic", "is_collectible": True}
    deck = [
        card(card_id=n, name=str(n), cost=n % 5 + 1, attack=n % 5 + 1, life=n % 4 + 2, **same)
        for n in range(100, 140)
    ]
    vocabulary = tuple(range(100, 140))
    make = inner_module(where, "", "swb.rl.aec_env").SWBAECEnv
    return make(deck, deck, class_a=1, class_b=1, card_vocabulary=vocabulary)


def hexagons(settings: str, **kwargs: Any) -> Any:
    """A board game of hexagonal tiles, by one of the files of settings that its own tests read."""
    where = "guilherme439+RL-SCS"
    folder = Path(os.environ["ZOO_REPOSITORIES"], where, "src/rl_scs/example_configurations")
    make = inner_module(where, "src", "rl_scs.SCS_Game").SCS_Game
    return make(str(folder / settings), **kwargs)


def coverage_with_links() -> Any:
    """Robots that explore the maps of its own tests and stay linked."""
    where = "Jcorrieri+multiagent-gridworld"
    maps = Path(os.environ["ZOO_REPOSITORIES"], where, "environment/obstacle-mats/testing")
    settings = {"map_dir_path": str(maps)}
    make = inner_module(where, "", "environment.envs.gridworld").GridWorldEnv
    return make(env_params=settings)


def air_ground_network() -> Any:
    """Drones between users and satellites, with its own defaults."""
    network = inner_module("scc2450+sagin_marl", "", "sagin_marl.env")
    return network.SaginParallelEnv(network.SaginConfig())


def graph_game(turns: bool = False) -> Any:
    """Two players on a ring of five nodes: its own training draws a graph of five."""
    import networkx

    module, factory = ("grag_turn_env", "GRAGTurnEnv") if turns else ("grag_env", "GRAGEnv")
    ring = networkx.cycle_graph(5)
    return of_repository("meedogh+grag-cysec", module, factory, graph=ring)


def formation() -> Any:
    """Drones that fly in formation, with the configuration of its third phase."""
    import yaml

    study = "Distributed-UAV-Swarm-Formation-Control-via-Object-Focused-Multi-Objective-SARSA"
    where = f"ahmedmsalah99+{study}"
    rules = inner_module(where, "", "modules.modules_manager")
    kinds = {
        "TGT": rules.TargetSeekModule,
        "COH": rules.CohesionModule,
        "ALN": rules.AlignmentModule,
        "COL": rules.CollisionModule,
        "OBS": rules.ObstacleAvoidanceModule,
    }
    config = yaml.safe_load(Path("configs/train_phase3.yaml").read_text())
    parts = {}
    for name, read in config["active_modules"].items():
        settings = {key: value for key, value in read.items() if key not in ("w", "Qmatrix_path")}
        parts[name] = kinds[name](weight=read["w"], **settings)
    make = inner_module(where, "", "uav_env.env.uav_environment").UAVEnvironment
    flown = config["env"]
    return make(agents_num=flown["agents_num"], env_params=flown, modules=parts)


def office_world() -> Any:
    """Two agents that deliver in an office, with the configuration of its own training."""
    where = "iamKateryna+minimaxproject"
    config = inner_module(where, "", "training_configurations").TrainingConfig
    make = inner_module(where, "", "envs.office_world.office_world_env").OfficeWorldEnv
    return make(
        map_object=config.map_object,
        map_type=config.map_type.value,
        coffee_type=config.coffee_type.value,
        predator_prey=config.predator_prey,
        allow_stealing=config.allow_stealing,
        agents_can_be_in_same_cell=config.can_be_in_same_cell,
    )


def archetype(kind: str) -> Any:
    """A society of multi-agent-sim, with the defaults of its kind."""
    where = "Harsh-617+multi-agent-sim"
    defaults = inner_module(where, "", f"simulation.config.{kind}_defaults")
    config = getattr(defaults, f"default_{kind}_config")()
    adapter = inner_module(where, "", f"simulation.adapters.{kind}_pettingzoo")
    return getattr(adapter, f"{kind.capitalize()}PettingZooParallelEnv")(config)
