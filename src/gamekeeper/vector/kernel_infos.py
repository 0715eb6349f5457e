"""Infos of a batch as dictionaries, as the faces of its kernel give them."""

from __future__ import annotations

from itertools import compress
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import MASK, Group, Kernel

Info = dict[str, Any]


class Infos:
    """Builds the infos of some copies at once: a list of each field first, dictionaries last."""

    def __init__(self, kernel: Kernel) -> None:
        """Takes the kernel whose infos they are."""
        self._kernel = kernel
        self._groups = [
            (k, group, i) for k, group in enumerate(kernel.groups) for i in range(group.count)
        ]

    def of_all(
        self, told: NDArray[Any], masks: list[NDArray[Any]], present: NDArray[np.bool_]
    ) -> list[dict[Any, Info]]:
        """By copy: agent to info, of those who are present.

        Args:
            told: [copy, agent] the fields of the kernel's infos.
            masks: of each group [copy, agent, flags]; empty without masks.
            present: [copy, agent].
        """
        names = self._kernel.agents
        columns = [
            self._rows(told[:, a], group, masks[k][:, i] if masks else None)
            for a, (k, group, i) in enumerate(self._groups)
        ]
        rows = zip(*columns, strict=True)
        if present.all():
            return [dict(zip(names, row, strict=True)) for row in rows]
        return [
            dict(compress(zip(names, row, strict=True), there))
            for row, there in zip(rows, present.tolist(), strict=True)
        ]

    def of_turns(
        self, told: NDArray[Any], masks: list[NDArray[Any]], turn: NDArray[Any]
    ) -> list[dict[Any, Info]]:
        """By copy: the agent in turn to its info; `told` [copy], masks [copy, flags]."""
        rows = self._rows(told, self._kernel.groups[0], masks[0] if masks else None)
        names = self._kernel.agents
        return [{names[a]: info} for a, info in zip(turn.tolist(), rows, strict=True)]

    def _rows(self, told: NDArray[Any], group: Group, flags: NDArray[Any] | None) -> list[Info]:
        columns: dict[str, list[Any]] = {}
        if self._kernel.info:
            columns = {name: _listed(told[name]) for name in told.dtype.names or ()}
        if flags is not None:
            columns[MASK] = _masks(flags, group.action_space)
        if not columns:
            return [{} for _ in range(len(told))]
        names = tuple(columns)
        return [dict(zip(names, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _listed(values: NDArray[Any]) -> list[Any]:
    """Python's numbers, or arrays that share nothing with the batch."""
    return list(values.copy()) if values.ndim > 1 else list(values.tolist())


def _masks(flags: NDArray[Any], space: spaces.Space[Any]) -> list[Any]:
    rows = list(flags.copy())
    if not isinstance(space, spaces.MultiDiscrete):
        return rows
    cuts = np.cumsum(space.nvec)[:-1]
    return [tuple(np.split(row, cuts)) for row in rows]
