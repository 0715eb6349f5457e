"""Last observations and infos of agents that ended, by sub-environment, made as they are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.interface.capture import AgentId
from gamekeeper.vector.vector_form import changed


class FinalRows(Sequence[Any]):
    """Objects [env]: None but for sub-environments in which an agent ended.

    They are made as they are read; `numpy.asarray` gives an array of all of them.

    Attributes:
        envs: [row], sub-environments that have one.
    """

    def __init__(self, num_envs: int, envs: NDArray[np.intp]) -> None:
        self.envs = envs
        self._rows = np.full(num_envs, -1)
        self._rows[envs] = np.arange(len(envs))

    def row(self, row: int) -> Any:
        """Returns the object of the sub-environment `envs[row]`."""
        raise NotImplementedError

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: Any) -> Any:
        rows = self._rows[index]
        if rows.ndim:
            return np.asarray(self)[index]
        return None if rows < 0 else self.row(int(rows))

    def __repr__(self) -> str:
        return repr(np.asarray(self))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        found = np.empty(len(self), object)
        for row, env in enumerate(self.envs.tolist()):
            found[env] = self.row(row)
        return found


class FinalObs(FinalRows):
    """Last observations.

    Attributes:
        tree: arrays [row, agent, ...], by role where agents differ in their spaces.
    """

    def __init__(self, num_envs: int, envs: NDArray[np.intp], tree: Any) -> None:
        super().__init__(num_envs, envs)
        self.tree = tree

    def row(self, row: int) -> Any:
        """Returns what the agents of a sub-environment saw last."""
        return changed(self.tree, itemgetter(row))


class FinalInfos(FinalRows):
    """Last infos, by agent.

    Args:
        told: infos of the agents that have a last observation, by sub-environment.
    """

    def __init__(self, num_envs: int, told: Mapping[int, Mapping[AgentId, Any]]) -> None:
        super().__init__(num_envs, np.fromiter(told, np.intp, len(told)))
        self._told = told

    def row(self, row: int) -> Any:
        """Returns what the agents of a sub-environment were told last."""
        return self._told[int(self.envs[row])]

    def absent(self, agents: Sequence[AgentId]) -> NDArray[np.bool_]:
        """Returns where these agents have no last observation, [row, agent]."""
        own = getattr(self._told, "absent", None)
        if own is not None:
            return np.asarray(own(agents))
        return np.array([[agent not in one for agent in agents] for one in self._told.values()])
