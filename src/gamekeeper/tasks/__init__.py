"""Gamekeeper's own tasks: importing this package registers them as `gamekeeper/<name>-v0`.

A task is a module and a contract beside it, `tag.py` and `tag.toml`, in this folder or in one of
its own; its class has the module's name (`two_robot_line`: TwoRobotLine). The classes are named as
text, so that a module is imported when its task is made.
"""

import tomllib
from pathlib import Path

import pettingzoo

_here = Path(__file__).parent
for _contract in sorted(_here.rglob("*.toml"), key=lambda path: path.stem):
    _name = _contract.stem
    _module = ".".join(_contract.relative_to(_here).with_suffix("").parts)
    _class = "".join(part.capitalize() for part in _name.split("_"))
    _api = tomllib.loads(_contract.read_text(encoding="utf-8"))["api"]
    pettingzoo.register(_api, f"gamekeeper/{_name}-v0", f"{__name__}.{_module}:{_class}")
