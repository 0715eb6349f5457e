"""Gamekeeper's own tasks: importing this package registers them as `gamekeeper/<name>-v0`.

The modules of the tasks are named as text, so they are imported when a task is made.
"""

from __future__ import annotations

from typing import Final, Literal

import pettingzoo

_TASKS: Final[tuple[tuple[Literal["aec", "parallel"], str, str], ...]] = (
    ("aec", "handover", "handover:Handover"),
    ("parallel", "two_robot_line", "two_robot_line:TwoRobotLine"),
    ("parallel", "warehouse", "warehouse:Warehouse"),
    ("aec", "warehouse_turns", "warehouse_turns:WarehouseTurns"),
)

for _api, _name, _class in _TASKS:
    pettingzoo.register(_api, f"gamekeeper/{_name}-v0", f"{__name__}.{_class}")
