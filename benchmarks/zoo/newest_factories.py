"""Factories for environments of the thirteenth and later lots of the zoo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from zoo_repositories import inner_module, of_repository, older


def city() -> Any:
    """Three builders of a city, without the package's list of games, which asks for others."""
    where = "srcJin+6.S890_Course_Project"
    inner_module(where, "src", "utils.logging")
    return of_repository(f"{where}:src/envs", "simcity", "SimCityEnv")


def exchange() -> Any:
    """Traders at an exchange, with the configuration of its own example."""
    market = inner_module("0xWelt+TradeMasterOnline", "", "tmo.env.trading_env")
    return market.TradingEnv.from_config("examples/configs/default.yaml")


def construction(module: str, factory: str) -> Any:
    """Robots that build a cottage, by the design that its own script reads."""
    where, package = "sriv144+embodied-skill-composer", "embodied_skill_composer.construction"
    read = inner_module(where, "src", f"{package}.runtime").load_house_design
    design = read(Path("configs/construction/cottage_v1.yaml").absolute())
    plan = inner_module(where, "src", f"{package}.compiler").compile_house_design(design)
    return getattr(inner_module(where, "src", f"{package}.{module}"), factory)(plan)


def railway() -> Any:
    """Two teams on a grid of railway lines, by the configuration of its own for one."""
    import yaml

    where = "scherven+jetlagtaiwan"
    grid = inner_module(where, "", "engine.grid_network").GridNetwork
    config = yaml.safe_load(Path("config_grid.yaml").read_text())
    sizes = [config["network"][f"grid_{name}"] for name in ("rows", "cols", "interval_minutes")]
    return inner_module(where, "", "agents.env_wrapper").RailGameEnv(config, grid(*sizes))


def high_ground() -> Any:
    """Two teams of three on the flat map of its own tests."""
    where = "TannerOlason+EECS590-RL-Capstone"
    maps = inner_module(where, "", "highground.maps.static_maps")
    return inner_module(where, "", "highground.env.srpg_env").HighGroundEnv(*maps.flat_open())


def draft() -> Any:
    """A draft of heroes, with the estimates at random that its own training uses."""
    import json

    mock = inner_module("Chrona0822+Dota2_Draft_Optimizer", "", "mock_eva").MockEvaluator
    read = json.loads(Path("models/hero_mappings.json").read_text())
    heroes = {w: {int(k): v for k, v in read[w].items()} for w in ("hero2idx", "idx2hero")}
    return older("bp_env", "DotaBPEnv", evaluator=mock(**heroes), **heroes)
