"""Gamekeeper's own tasks: importing this package registers them as `gamekeeper/<name>-v0`.

A task is a module and a contract beside it, `warehouse.py` and `warehouse.toml`; its class has the
module's name (`two_robot_line`: TwoRobotLine). The classes are named as text, so that a module is
imported when its task is made.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import pettingzoo

for _contract in sorted(Path(__file__).parent.glob("*.toml")):
    _name = _contract.stem
    _class = "".join(part.capitalize() for part in _name.split("_"))
    _api = tomllib.loads(_contract.read_text(encoding="utf-8"))["api"]
    pettingzoo.register(_api, f"gamekeeper/{_name}-v0", f"{__name__}.{_name}:{_class}")
