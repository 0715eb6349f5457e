"""Last observations and infos of agents that ended, by sub-environment, made as they are read."""

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from gamekeeper.interface.capture import AgentId
from gamekeeper.vector.vector_form import changed


class FinalRows(NDArrayOperatorsMixin):
    """Array [env] of objects: None but for sub-environments in which an agent ended.

    It behaves as Gymnasium's array of objects does: indices, masks, operators, attributes, NumPy's
    functions. An object is made as it is read; all of them, once, where more than one is.

    Attributes:
        envs: [row], sub-environments that have one.
        rows: [env], the row of each; -1 without one.
    """

    def __init__(self, num_envs: int, envs: NDArray[np.intp]) -> None:
        self.envs, self.rows = envs, np.full(num_envs, -1)
        self.rows[envs] = np.arange(len(envs))
        self._made: NDArray[Any] | None = None

    def row(self, row: int) -> Any:
        """Returns the object of the sub-environment `envs[row]`."""
        raise NotImplementedError

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        if self._made is not None or np.ndim(rows := self.rows[index]):
            return self.__array__()[index]
        return None if rows < 0 else self.row(int(rows))

    def __setitem__(self, index: Any, value: Any) -> None:
        self.__array__()[index] = value

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.__array__(), name)

    def __repr__(self) -> str:
        return repr(self.__array__())

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if self._made is None:
            self._made = np.empty(len(self), object)
            for row, env in enumerate(self.envs.tolist()):
                self._made[env] = self.row(row)
        return np.array(self._made, dtype, copy=copy)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        arrays = (np.asarray(x) if isinstance(x, FinalRows) else x for x in inputs)
        return getattr(ufunc, method)(*arrays, **options)


class FinalObs(FinalRows):
    """Last observations.

    Attributes:
        tree: arrays [row, agent, ...], by role where agents differ in their spaces.
    """

    def __init__(self, num_envs: int, envs: NDArray[np.intp], tree: Any) -> None:
        super().__init__(num_envs, envs)
        self.tree = tree

    def row(self, row: int) -> Any:
        """Returns the last observations of a sub-environment's agents."""
        return changed(self.tree, itemgetter(row))


class FinalInfos(FinalRows):
    """Last infos, by agent.

    Args:
        infos: infos of the agents that have a last observation, by sub-environment.
    """

    def __init__(self, num_envs: int, infos: Mapping[int, Mapping[AgentId, Any]]) -> None:
        super().__init__(num_envs, np.fromiter(infos, np.intp, len(infos)))
        self._infos = infos

    def row(self, row: int) -> Any:
        """Returns the last infos of a sub-environment's agents."""
        return self._infos[int(self.envs[row])]

    def absent(self, agents: Sequence[AgentId]) -> NDArray[np.bool_]:
        """Returns where these agents have no last observation, [row, agent]."""
        own = getattr(self._infos, "absent", None)
        if own is not None:
            return np.asarray(own(agents))
        return np.array([[agent not in one for agent in agents] for one in self._infos.values()])


class AgentInfos(FinalRows):
    """Last infos where every agent is a sub-environment of its own.

    Args:
        num_envs: number of these sub-environments.
        envs: those whose agents ended.
        infos: infos by agent, for each copy.
        agents: of every copy, in their order.
    """

    def __init__(
        self, num_envs: int, envs: NDArray[np.intp], infos: FinalRows, agents: Sequence[AgentId]
    ) -> None:
        super().__init__(num_envs, envs)
        self._infos, self._agents = infos, agents

    def row(self, row: int) -> Any:
        """Returns the last info of an agent."""
        copy, place = divmod(int(self.envs[row]), len(self._agents))
        return self._infos[copy].get(self._agents[place], {})
