"""An environment that attacks whoever records it: one way of `WAYS`, in one place, in both APIs."""

import locale
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

ESCAPE: Final = "\x1b[2J\x1b]0;owned\x07\x9b31m"
HUGE: Final = "x" * 5_000_000
LENGTH: Final = 4


def _refuse(kind: type[BaseException] = RuntimeError) -> Callable[..., Any]:
    def refused(*_: object, **__: object) -> Any:
        raise kind("hostile")

    return refused


def _texts(way: str) -> Any:
    """What `__str__` and `__repr__` do in this way."""
    return {
        "raises": _refuse(),
        "raises-base": _refuse(GeneratorExit),
        "raises-exit": _refuse(SystemExit),
        "no-text": lambda self: 7,
        "huge": lambda self: HUGE,
        "escape": lambda self: ESCAPE,
        "surrogate": lambda self: "\ud800",
    }[way]


def error_of(way: str, base: type[BaseException] = Exception) -> BaseException:
    """An exception whose texts are hostile in this way."""
    if way in ("huge", "escape", "surrogate"):
        return base({"huge": HUGE, "escape": ESCAPE, "surrogate": "\ud800"}[way])
    members = {"__str__": _texts(way), "__repr__": _texts(way), "__doc__": None}
    return type("HostileError", (base,), members)()


METHODS: Final = (
    "__array__",
    "__array_interface__",
    "__len__",
    "__eq__",
    "__ne__",
    "__float__",
    "__int__",
    "__index__",
    "__bool__",
    "__iter__",
    "__getitem__",
    "__deepcopy__",
    "__copy__",
    "__reduce__",
    "__reduce_ex__",
    "__str__",
    "__repr__",
    "__format__",
    "__lt__",
    "__contains__",
    "__abs__",
    "__add__",
    "__radd__",
    "__neg__",
    "__sub__",
    "__rsub__",
    "__mul__",
    "__rmul__",
)


def value_of(base: type, way: str, *arguments: object) -> Any:
    """An object of a subclass of `base` whose methods raise."""
    kind = {"raises-base": GeneratorExit, "raises-exit": SystemExit}.get(way, RuntimeError)
    members: dict[str, Any] = {name: _refuse(kind) for name in METHODS}
    members["__hash__"] = base.__hash__ if base is not object else object.__hash__
    if way == "attribute":
        members["__getattribute__"] = _refuse()
    if way == "class":
        members = {"__class__": property(_refuse())}
    return type("Hostile", (base,), members)(*arguments)


def agent_of(way: str) -> Any:
    """An agent's id of a `str` subclass; its hash raises, too, where that is the way."""
    if way in ("unhashable", "hash"):
        calls = iter(range(3 if way == "hash" else 40))

        def hashed(self: str) -> int:
            if next(calls, None) is None:
                raise RuntimeError("hostile")
            return str.__hash__(self)

        return type("Name", (str,), {"__hash__": hashed, "__eq__": str.__eq__})("bee")
    if way == "list":
        return ["bee"]
    members = {f"__{way}__": _refuse(), "__hash__": str.__hash__}
    if way == "hash-only":
        members = {"__hash__": _refuse()}
    return type("Name", (str,), members)("bee")


def space_of(way: str) -> Any:
    """A space that is no plain one."""
    inner: Any = spaces.Discrete(2)
    if way in ("tuple", "dict"):
        for _ in range(400):
            inner = spaces.Tuple((inner,)) if way == "tuple" else spaces.Dict({"a": inner})
        return inner
    if way in ("recursive-tuple", "recursive-dict"):
        own: Any = spaces.Tuple((inner,)) if way == "recursive-tuple" else spaces.Dict({"a": inner})
        own.spaces = (own,) if way == "recursive-tuple" else {"a": own}
        return own
    if way == "wide":
        wide = spaces.Tuple((inner, inner))
        for _ in range(40):
            wide = spaces.Tuple((wide, wide))
        return wide
    members = {name: _refuse() for name in ("__eq__", "__repr__", "contains", "sample", "shape")}
    return type("Hostile", (spaces.Discrete,), members)(2)


def _closed() -> None:
    sys.stdout.close()
    sys.stderr.close()


def _no_streams() -> None:
    sys.stdout = sys.stderr = None


def _other_streams() -> None:
    sys.stdout = sys.stderr = value_of(object, "raises")


def _dead_streams() -> None:
    sys.stdout = sys.stderr = sys.__stdout__ = sys.__stderr__ = object()  # type: ignore[assignment,misc]


def _recurse_less() -> None:
    sys.setrecursionlimit(80)


def _cwd_gone() -> None:
    import tempfile

    folder = tempfile.mkdtemp()
    os.chdir(folder)
    Path(folder).rmdir()


def _signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP, signal.SIGCHLD):
        signal.signal(number, lambda *_: sys.exit(7))
    signal.setitimer(signal.ITIMER_REAL, 0)


def _locale() -> None:
    locale.setlocale(locale.LC_ALL, "C")
    os.environ.update(LC_ALL="C", LANG="C", PYTHONIOENCODING="ascii")


def _warnings() -> None:
    warnings.resetwarnings()
    warnings.simplefilter("error")
    warnings.showwarning = _refuse()
    np.seterr(all="raise")


def _hooks() -> None:
    import atexit

    sys.excepthook = sys.unraisablehook = _refuse()
    sys.displayhook = _refuse()
    atexit.register(_refuse())
    sys.settrace(None)


def _daemon() -> None:
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            for _ in range(int(os.environ.get("HOSTILE_S", "20")) * 10):
                time.sleep(0.1)
        os._exit(0)
    os.wait()


MEDDLES: Final[dict[str, Callable[[], Any]]] = {
    "streams-none": _no_streams,
    "streams-closed": _closed,
    "streams-replaced": _other_streams,
    "streams-dead": _dead_streams,
    "recursion": _recurse_less,
    "cwd-gone": _cwd_gone,
    "chdir": lambda: os.chdir("/"),
    "signals": _signals,
    "umask": lambda: os.umask(0o777),
    "locale": _locale,
    "warnings": _warnings,
    "environ": os.environ.clear,
    "hooks": _hooks,
    "path": lambda: setattr(sys, "path", []),
    "modules": lambda: [sys.modules.pop(name) for name in list(sys.modules) if name[0] != "_"],
    "daemon": _daemon,
    "switch": lambda: sys.setswitchinterval(1.0),
    "argv": lambda: setattr(sys, "argv", []),
}
"""What an environment may change of its process."""


class _Hostile:
    """What both APIs share: two agents, four turns, and one thing that is hostile."""

    metadata: ClassVar[Any] = {"name": "hostile_v0", "render_modes": []}

    def __init__(self, what: str = "", way: str = "", at: str = "step", render_mode: Any = None):
        self.what, self.way, self.at, self.now, self.render_mode = what, way, at, 0, render_mode
        other = agent_of(way) if what == "agent" else "bee"
        self.possible_agents: list[Any] = ["ant", other]
        self.agents: list[Any] = []
        if what == "metadata":
            self.metadata = value_of(dict, way) if way != "name" else {"name": value_of(str, way)}
        self._spaces = [spaces.Box(0, 9, (1,), np.float32), spaces.Discrete(2)]
        if what == "space":
            self._spaces[0] = space_of(way)
        elif what == "action-space":
            self._spaces[1] = space_of(way)
        self.call("init")

    def call(self, place: str) -> None:
        """Does its thing where this is the place and it is something done."""
        if place != self.at or (place == "step" and self.now < 2):
            return
        if self.what in ("meddle", "meddle-raise"):
            MEDDLES[self.way]()
            if self.what == "meddle-raise":
                raise error_of("raises")
        elif self.what == "error":
            raise error_of(self.way)
        elif self.what == "base-error":
            raise error_of(self.way, BaseException)
        elif self.what == "group":
            raise ExceptionGroup("hostile", [error_of(self.way)])  # type: ignore[list-item]
        elif self.what == "cause":
            raise ValueError("plain") from error_of(self.way)
        elif self.what == "raise":
            kinds: Any = {
                "exit": SystemExit,
                "interrupt": KeyboardInterrupt,
                "gen": GeneratorExit,
                "recursion": RecursionError,
                "memory": MemoryError,
                "stop": StopIteration,
            }
            raise kinds[self.way]("hostile")

    def given(self, what: str, plain: Any) -> Any:
        """The plain value, or a hostile one where this is what is hostile."""
        if what != self.what or self.now < 2:
            return plain
        if self.way == "numpy":
            return value_of(np.ndarray, self.way, (1,), np.float32)
        if self.way in ("float", "int", "str", "dict", "list"):
            base: type = {"float": float, "int": int, "str": str, "dict": dict, "list": list}[
                self.way
            ]
            return value_of(base, self.way)
        if self.way in ("huge", "escape", "surrogate"):
            return {"huge": HUGE, "escape": ESCAPE, "surrogate": "\ud800"}[self.way]
        return value_of(object, self.way)

    def info(self) -> Any:
        """An info: itself, a value or a key of it may be hostile."""
        info: Any = {"value": self.given("info-value", 1)}
        if self.what == "info-key" and self.now >= 2:
            info[self.given("info-key", "key")] = 1
        if self.what == "mask" and self.now >= 2:
            info["action_mask"] = self.given("mask", None)
        return self.given("info", info)

    def see(self) -> Any:
        """An observation."""
        space = self._spaces[0]
        if self.what == "space":
            return 0
        return self.given("obs", np.array([self.now], space.dtype))

    def observation_space(self, agent: Any) -> Any:
        """The same for all."""
        return self._spaces[0]

    def action_space(self, agent: Any) -> Any:
        """The same for all."""
        return self._spaces[1]

    def state(self) -> Any:
        """The time."""
        self.call("state")
        return self.given("state", np.array([self.now], np.float32))

    def close(self) -> None:
        """Does its thing where this is the place."""
        self.call("close")


class HostileTicks(_Hostile, ParallelEnv):  # type: ignore[type-arg,misc]
    """The Parallel one."""

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        """Begins an episode."""
        self.agents, self.now = list(self.possible_agents), 0
        self.call("reset")
        return {a: self.see() for a in self.agents}, {a: self.info() for a in self.agents}

    def step(self, actions: Any) -> Any:
        """Makes one tick."""
        self.now += 1
        self.call("step")
        live, is_over = self.agents, self.now >= LENGTH
        self.agents = [] if is_over else live
        return (
            {a: self.see() for a in live},
            {a: self.given("reward", 1.0) for a in live},
            {a: self.given("flag", is_over) for a in live},
            dict.fromkeys(live, False),
            {a: self.info() for a in live},
        )


class HostileTurns(_Hostile, AECEnv):  # type: ignore[type-arg,misc]
    """The AEC one."""

    def reset(self, seed: Any = None, options: Any = None) -> None:
        """Begins an episode."""
        self.agents, self.now = list(self.possible_agents), 0
        self.rewards: Any = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards: Any = dict.fromkeys(self.agents, 0.0)
        self.terminations: Any = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: Any = {a: self.info() for a in self.agents}
        self.agent_selection = self.agents[0]
        self.call("reset")

    def observe(self, agent: Any) -> Any:
        """Looks, as everybody does."""
        return self.see()

    def step(self, action: Any) -> None:
        """Makes one turn."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self.now += 1
        self.call("step")
        self.rewards = {a: self.given("reward", float(a is agent)) for a in self.agents}
        self._cumulative_rewards[agent] = self.given("reward", 0.0)
        self.infos = {a: self.info() for a in self.agents}
        if self.now >= LENGTH:
            self.terminations = {a: self.given("flag", True) for a in self.agents}
        self.agent_selection = self.agents[self.now % len(self.agents)]


def ticks(**settings: Any) -> HostileTicks:
    """A new Parallel one."""
    return HostileTicks(**settings)


def turns(**settings: Any) -> HostileTurns:
    """A new AEC one."""
    return HostileTurns(**settings)
