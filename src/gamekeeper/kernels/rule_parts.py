"""A kernel's rules in the form in which drivers call them: one signature, compiled or plain."""

from dataclasses import dataclass
from typing import Any, Final

from gymnasium import spaces

from gamekeeper.kernels.array_views import plain_row, row
from gamekeeper.kernels.kernel import MASK, Kernel
from gamekeeper.kernels.scalar_rules import as_python, inner

HORIZON: Final = -1
"""Value of `s.ending` for an agent that met the horizon."""
UNNAMED: Final = 127
"""Value of `s.ending` for an agent that ended without a named reason."""


@dataclass(frozen=True)
class Parts:
    """Functions that a driver is made of."""

    kernel: Kernel
    is_plain: bool

    @property
    def row(self) -> Any:
        """`row(arrays, e)`, one copy's views."""
        return plain_row if self.is_plain else row

    @property
    def is_timed(self) -> bool:
        """True where `s.limit` says after how many ticks all agents are truncated."""
        return self.kernel.limit > 0

    def rule(self, name: str) -> Any:
        """The kernel's rule of that name, with `t` (tables) as its second argument.

        A rule that the kernel hasn't got does nothing.
        """
        function = getattr(self.kernel, name)
        if function is None:
            return self.made(_NOTHING[self._count(name)])
        return self.with_tables(function, self._count(name))

    def with_tables(self, function: Any, count: int) -> Any:
        """A rule that takes `t`, whether or not it wants it; `count` further arguments follow."""
        found = self.own(function)
        if self.kernel.tables is not None:
            return found
        return self.made(_WITHOUT_TABLES[count](found))

    def own(self, function: Any) -> Any:
        """A rule, or its plain counterpart."""
        return as_python(function) if self.is_plain else self.made(function.py_func)

    def made(self, function: Any) -> Any:
        """A function of the driver's, compiled unless plain; always into its caller.

        A call hands over seven words for each array, and that costs more than a cheap rule.
        """
        return function if self.is_plain else inner(function, forceinline=True)

    def _count(self, name: str) -> int:
        turns = self.kernel.api == "aec"
        counts = {"reset": 0, "step": 4, "act": 5, "overview": 1}
        return counts.get(name, 2 if turns else 1)

    def blank(self) -> Any:
        """`blank(obs, i)`: agent i's places hold zeros (of ticks)."""
        clear: Any = self.made(_nothing2)
        for g, group in enumerate(self.kernel.groups):
            keys = list(getattr(group.observation_space, "spaces", {}))
            filled = [key for key in keys if key != MASK or self.kernel.mask is None]
            for leaf in range(len(filled)) if keys else (None,):
                clear = self._also(clear, g, leaf)
        return clear

    def blank_mask(self) -> Any:
        """`blank(masks, i)`: agent i may do nothing (of ticks)."""
        clear: Any = self.made(_nothing2)
        for g, group in enumerate(self.kernel.groups):
            if self.kernel.flags(group):
                clear = self._also(clear, g, None)
        return clear

    def blank_whole(self) -> Any:
        """`blank(obs)`: what the agent in turn is shown becomes zeros (of turns)."""
        space = self.kernel.groups[0].observation_space
        if not isinstance(space, spaces.Dict):
            return self.made(_zeros if space.shape else _zero)
        clear: Any = self.made(_nothing1)
        filled = [key for key in space.spaces if key != MASK or self.kernel.mask is None]
        for leaf, key in enumerate(filled):
            clear = self.made(_then(clear, leaf, bool(space.spaces[key].shape)))
        return clear

    def _also(self, before: Any, g: int, leaf: int | None) -> Any:
        """Function that clears all that `before` does, and one array of group g."""
        groups = self.kernel.groups
        one = self.made(_clearer(g if len(groups) > 1 else None, leaf))
        return self.made(_both(before, one, groups[g].first, groups[g].count))


def _nothing1(a: Any) -> None:
    pass


def _zeros(whole: Any) -> None:
    whole[:] = 0


def _zero(whole: Any) -> None:
    whole[()] = 0


def _then(before: Any, leaf: int, has_axes: bool) -> Any:
    if has_axes:

        def clear(whole: Any) -> None:
            before(whole)
            whole[leaf][:] = 0

    else:

        def clear(whole: Any) -> None:
            before(whole)
            whole[leaf][()] = 0

    return clear


def _nothing2(s: Any, t: Any) -> None:
    pass


_NOTHING: Final[dict[int, Any]] = {
    0: _nothing2,
    1: lambda s, t, a: None,
    2: lambda s, t, a, b: None,
}
_WITHOUT_TABLES: Final[dict[int, Any]] = {
    0: lambda rule: lambda s, t: rule(s),
    1: lambda rule: lambda s, t, a: rule(s, a),
    2: lambda rule: lambda s, t, a, b: rule(s, a, b),
    4: lambda rule: lambda s, t, a, b, c, d: rule(s, a, b, c, d),
    5: lambda rule: lambda s, t, a, b, c, d, e: rule(s, a, b, c, d, e),
}


def _clearer(g: int | None, leaf: int | None) -> Any:
    """Zeros in place i of one array: itself, or one of a tuple's, or of a tuple in a tuple."""
    if g is None and leaf is None:

        def clear(whole: Any, i: Any) -> None:
            whole[i] = 0

    elif g is None or leaf is None:
        place = leaf if g is None else g

        def clear(whole: Any, i: Any) -> None:
            whole[place][i] = 0

    else:

        def clear(whole: Any, i: Any) -> None:
            whole[g][leaf][i] = 0

    return clear


def _both(before: Any, one: Any, first: int, count: int) -> Any:
    def clear(whole: Any, i: Any) -> None:
        before(whole, i)
        if first <= i < first + count:
            one(whole, i - first)

    return clear
