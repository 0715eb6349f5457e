"""Causes held still, by Python that stands at the head of a reproducer.

Each function takes the `make` of a reproducer and returns one that builds the same environment with
one cause held still. Its source stands at the head of the program, so it names nothing of ours.
"""

import collections
import contextlib
import copy
import gc
import inspect
import random
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gamekeeper.auditing.class_state import kept_by_classes, put_back


def with_class(env: Any, **methods: Any) -> Any:
    """The environment, with these methods in front: of one class for all, or pickle takes none."""
    main, cls = vars(sys.modules["__main__"]), type(env)
    made_of = cls, [getattr(each, "fget", each).__code__ for each in methods.values()]
    name = f"Held{cls.__qualname__.rpartition('.')[2]}"  # for pickle; errors name the class's own
    methods |= {"made_of": made_of, "__module__": "__main__", "__qualname__": name}
    if getattr(main.get(name), "made_of", None) != made_of:
        main[name] = type(cls.__name__, (cls,), methods)
    env.__class__ = main[name]
    return env


def with_methods(make: Callable[[], Any], methods: Callable[[Any], Any]) -> Callable[[], Any]:
    """Builds the environment, and puts methods in front of those of its class."""

    def built() -> Any:
        env = make()
        return with_class(env, **methods(type(env)))

    return built


def before_resets(make: Callable[[], Any], prepare: Callable[[Any], object]) -> Callable[[], Any]:
    """Builds the environment, and calls `prepare` with it before each of its resets."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            prepare(self)
            return cls.reset(self, *args, **kwargs)

        return {"reset": reset}

    return with_methods(make, methods)


def calls_of_class(make: Callable[[], Any]) -> Callable[[], Any]:
    """Puts calls that an instance has as attributes of its own where a class can replace them."""
    names = "reset", "step", "observe", "state", "render"

    def built() -> Any:
        env = make()
        own = {name: env.__dict__.pop(name) for name in names if name in vars(env)}
        if not own:
            return env
        env.__dict__["own_calls"] = own

        def called(name: str) -> Callable[..., Any]:
            return lambda self, *args, **kwargs: self.__dict__["own_calls"][name](*args, **kwargs)

        return with_class(env, **{name: called(name) for name in own})

    return built


def global_states() -> tuple[Any, ...]:
    """The states of the global generators: numpy's, Python's, and torch's where it is loaded."""
    torch = sys.modules.get("torch")
    return np.random.get_state(), random.getstate(), torch and torch.get_rng_state()


def put_global_states(states: tuple[Any, ...]) -> None:
    """Puts states back that `global_states` gave."""
    np.random.set_state(states[0])
    random.setstate(states[1])
    if states[2] is not None:
        sys.modules["torch"].set_rng_state(states[2])


def own_generators(root: Any) -> Iterator[Any]:
    """Random generators that an environment holds, itself or in what it holds."""
    seen: dict[int, Any] = {}
    waiting = [root]
    while waiting and len(seen) < 100_000:
        each = waiting.pop()
        if id(each) in seen or inspect.isroutine(each) or inspect.ismodule(each):
            continue
        seen[id(each)] = each
        if isinstance(each, np.random.Generator | np.random.RandomState | random.Random):
            yield each
        elif not isinstance(each, type):
            waiting += gc.get_referents(each)


def instances_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Resets a fresh instance in place of a used one."""

    def renew(env: Any) -> None:
        env.__dict__.clear()
        env.__dict__.update(make().__dict__)

    return before_resets(make, renew)


def contents_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Gives lists, dictionaries and the like the content of the constructor at each reset."""

    def built() -> Any:
        env = make()
        kinds = list, dict, set, collections.deque
        own = {name: each for name, each in vars(env.unwrapped).items() if isinstance(each, kinds)}
        env.__dict__["built_with"] = copy.deepcopy(own)
        return env

    return before_resets(
        built, lambda env: vars(env.unwrapped).update(copy.deepcopy(env.__dict__["built_with"]))
    )


def copies_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Makes each copy by playing the same calls again in a fresh instance."""

    def played(calls: Any) -> Any:
        env = built()
        for name, args, kwargs in calls:
            getattr(env, name)(*args, **kwargs)
        return env

    def built() -> Any:
        env = make()
        cls = type(env)
        env.__dict__["calls_made"] = []

        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            self.__dict__["calls_made"] = [("reset", args, kwargs)]
            return cls.reset(self, *args, **kwargs)

        def step(self: Any, action: Any) -> Any:
            self.__dict__["calls_made"].append(("step", (copy.deepcopy(action),), {}))
            return cls.step(self, action)

        def duplicate(self: Any, memo: Any) -> Any:
            return played(list(self.__dict__["calls_made"]))

        def reduce(self: Any, protocol: Any) -> Any:
            return played, (list(self.__dict__["calls_made"]),)

        played.__module__, played.__qualname__ = "__main__", "played"
        sys.modules["__main__"].__dict__["played"] = played  # by which pickle finds it
        methods = {"__deepcopy__": duplicate, "__reduce_ex__": reduce}
        return with_class(env, reset=reset, step=step, **methods)

    return built


def _with_outputs(make: Callable[[], Any], changed: Callable[..., Any]) -> Callable[[], Any]:
    """Hands what reset and step give to a function, with the agents that lived before.

    The function returns it, and may change the environment's books.
    """

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            return changed(self, cls.reset(self, *args, **kwargs), [])

        def step(self: Any, action: Any) -> Any:
            before = list(self.agents)
            return changed(self, cls.step(self, action), before)

        return {"reset": reset, "step": step}

    return with_methods(make, methods)


def observations_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Copies each observation before it is handed out."""

    def changed(env: Any, out: Any, before: Any) -> Any:
        if out is None:
            return out
        return ({agent: copy.deepcopy(each) for agent, each in out[0].items()}, *out[1:])

    return with_methods(
        _with_outputs(make, changed),
        lambda cls: {"observe": lambda self, agent: copy.deepcopy(cls.observe(self, agent))},
    )


def infos_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Copies each info as it is put into `infos`, and before it is handed out."""

    class InfosCopied(dict):  # type: ignore[type-arg]  # in a program no name of typing is known
        def __setitem__(self, key: Any, value: Any) -> None:
            super().__setitem__(key, copied(value))

    def copied(value: Any) -> Any:
        if not isinstance(value, dict):
            return copy.deepcopy(value)
        own = InfosCopied()
        for key, each in value.items():
            own[key] = each
        return own

    def changed(env: Any, out: Any, before: Any) -> Any:
        if out is None:
            env.infos = {agent: copy.deepcopy(info) for agent, info in env.infos.items()}
            return None
        return (*out[:-1], {agent: copy.deepcopy(info) for agent, info in out[-1].items()})

    def built() -> Any:
        env = make()
        rules = env.unwrapped
        cls: Any = type(rules)

        def put(self: Any, name: str, value: Any) -> None:
            cls.__setattr__(self, name, copied(value) if name == "infos" else value)

        if hasattr(cls, "agent_iter"):  # of another form nothing is kept in `infos`
            with_class(rules, __setattr__=put)
        return env

    return _with_outputs(built, changed)


def state_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Copies what `state()` gives before it is handed out."""
    return with_methods(make, lambda cls: {"state": lambda self: copy.deepcopy(cls.state(self))})


def left_alone(call: Callable[..., Any]) -> Callable[..., Any]:
    """Makes a call of a copy; else puts the environment's generators back after it.

    The global ones are put back in either case.
    """

    def called(self: Any, *args: Any) -> Any:
        shared = global_states()
        try:
            with contextlib.suppress(Exception):  # of a window there is no copy
                return call(copy.deepcopy(self), *args)
            # where they stand is in copies of them, and a copy's draw leaves them alone
            before = [(each, copy.deepcopy(each)) for each in own_generators(self)]
            value = call(self, *args)
            for each, stood in before:
                if isinstance(each, random.Random):
                    each.setstate(stood.getstate())
                elif isinstance(each, np.random.RandomState):
                    each.set_state(stood.get_state())
                else:
                    each.bit_generator.state = stood.bit_generator.state
            return value
        finally:
            put_global_states(shared)

    return called


def readings_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Calls `state()` and `render()` so that they leave the game and all generators alone."""
    return with_methods(
        make, lambda cls: {"state": left_alone(cls.state), "render": left_alone(cls.render)}
    )


def observe_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Calls `observe()` so that it leaves the game and all generators alone."""
    return with_methods(make, lambda cls: {"observe": left_alone(cls.observe)})


def rewards_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Clears `rewards` before each step."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def step(self: Any, action: Any) -> Any:
            for agent in getattr(self, "rewards", ()):
                self.rewards[agent] = 0
            return cls.step(self, action)

        return {"step": step}

    return with_methods(make, methods)


def names_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Leaves each agent once in the rosters."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def once(name: str) -> Callable[..., Any]:
            def call(self: Any, *args: Any, **kwargs: Any) -> Any:
                out = getattr(cls, name)(self, *args, **kwargs)
                for roster in (self.agents, self.possible_agents):
                    roster[:] = dict.fromkeys(roster)
                return out

            return call

        return {name: once(name) for name in ("reset", "step")}

    return with_methods(make, methods)


def rosters_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Names all possible agents again before each reset, in a list of their own."""
    names = list(make().possible_agents)
    return before_resets(make, lambda env: setattr(env, "possible_agents", list(names)))


def agents_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Names all possible agents in `agents` before each reset, as none has left."""
    return before_resets(
        make, lambda env: setattr(env.unwrapped, "agents", list(env.possible_agents))
    )


def ended_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Takes agents that have ended out of `agents`; without agents nothing is played on."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def step(self: Any, actions: Any) -> Any:
            if not self.agents:
                return {}, {}, {}, {}, {}
            out = cls.step(self, {a: x for a, x in actions.items() if a in self.agents})
            ended = {a for flags in out[2:4] for a, flag in flags.items() if flag}
            self.agents = [a for a in self.agents if a not in ended]
            return out

        return {"step": step}

    return with_methods(make, methods)


def flags_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Keeps the flags of agents that have ended up, as long as they are in `agents`."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def step(self: Any, action: Any) -> None:
            books = self.terminations, self.truncations
            up = [[agent for agent, flag in book.items() if flag] for book in books]
            cls.step(self, action)
            for book, ended in zip((self.terminations, self.truncations), up, strict=True):
                book.update(dict.fromkeys((a for a in ended if a in self.agents), True))

        return {"step": step}

    return with_methods(make, methods)


def dead_steps_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Makes steps of ended agents as PettingZoo does; without agents nothing is played on."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def last(self: Any, observe: bool = True) -> Any:
            return cls.last(self, observe) if self.agents else (None, 0.0, True, False, {})

        def step(self: Any, action: Any) -> Any:
            agent, flags = self.agent_selection, (self.terminations, self.truncations)
            if self.agents and not any(book[agent] for book in flags):
                return cls.step(self, action)
            if self.agents or action is not None:
                sys.modules["pettingzoo"].AECEnv._was_dead_step(self.unwrapped, action)
            layer = self
            while layer is not self.unwrapped and layer is not None:  # a wrapper's own roster
                if agent in vars(layer).get("agents", ()):
                    layer.agents.remove(agent)
                layer = vars(layer).get("env")
            return None

        return {"last": last, "step": step}

    return with_methods(make, methods)


def entries_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Deletes entries of agents that aren't in the game from rewards and flags."""

    def changed(env: Any, out: Any, before: Any) -> Any:
        if out is None:
            books = env.rewards, env._cumulative_rewards, env.terminations, env.truncations
            for book in books:
                for agent in set(book) - set(env.agents):
                    del book[agent]
        elif len(out) == 5:
            for book in out[1:4]:
                for agent in set(book) - set(env.agents) - set(before):
                    del book[agent]
        return out

    return _with_outputs(make, changed)


def missing_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Gives each agent in the game the entries of rewards, flags and infos that it lacks.

    So it does in a Parallel environment for one that the step takes out. What the first reset
    doesn't set, later ones don't leave from the last episode.
    """
    names = "rewards", "terminations", "truncations", "infos", "_cumulative_rewards"
    values: Any = 0.0, False, False, {}, 0.0

    def book_of(env: Any, name: str) -> Any:
        return getattr(env, name, None) or vars(env.unwrapped).setdefault(name, {})

    def changed(env: Any, out: Any, before: Any) -> Any:
        if isinstance(out, tuple) and len(out) == 5:
            books, agents = list(out[1:]), (*env.agents, *before)
        elif hasattr(type(env), "agent_iter"):
            books, agents = [book_of(env, name) for name in names], env.agents
            lacking = {n for n, book in zip(names, books, strict=True) if set(agents) - set(book)}
            env.__dict__.setdefault("never_set", lacking)
        else:
            return out
        for book, value in zip(books, values, strict=False):
            for agent in agents:
                book.setdefault(agent, copy.copy(value))
        return out

    def forget(env: Any) -> None:
        for name in env.__dict__.get("never_set", ()):
            book_of(env, name).clear()

    return before_resets(_with_outputs(make, changed), forget)


def containers_of(root: Any) -> Iterator[Any]:
    """Dictionaries, lists and arrays that an environment keeps; spaces, whose bounds stay, not."""
    seen: dict[int, Any] = {}
    waiting = [vars(root)]
    while waiting and len(seen) < 100_000:
        each = waiting.pop()
        if id(each) in seen or isinstance(each, type) or hasattr(each, "contains"):
            continue
        seen[id(each)] = each
        if isinstance(each, dict | list | np.ndarray):
            yield each
        if isinstance(each, dict):
            waiting += each.values()
        elif isinstance(each, list | tuple | set | collections.deque):
            waiting += each
        elif not inspect.isroutine(each) and not inspect.ismodule(each):
            waiting += [vars(each)] if hasattr(each, "__dict__") else []


def set_in(container: Any, value: Any, bound: Any) -> None:
    """Puts the bound where a container has a number that was observed as `value`."""
    is_whole = isinstance(value, np.integer)
    if isinstance(container, np.ndarray):
        if container.dtype.kind in "iuf" and container.flags.writeable:
            container[(container if is_whole else container.astype(type(value))) == value] = bound
        return
    places = list(container.items() if isinstance(container, dict) else enumerate(container))
    for key, each in places:
        is_number = isinstance(each, int | float | np.number) and not isinstance(each, bool)
        if is_number and (each if is_whole else type(value)(each)) == value:
            container[key] = type(each)(bound)


def bounds_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Sets what agents observe beyond a bound to the bound, where the environment keeps it."""

    def outside(space: Any, value: Any) -> Iterator[Any]:
        if hasattr(space, "spaces"):
            keys = space.spaces if isinstance(space.spaces, dict) else range(len(space.spaces))
            for key in keys:
                yield from outside(space[key], value[key])
        elif hasattr(space, "low"):
            bounds = np.clip(value, space.low, space.high)
            for each, bound in zip(np.ravel(value), np.ravel(bounds), strict=True):
                if each != bound:
                    yield each, bound

    def changed(env: Any, out: Any, before: Any) -> Any:
        if out is None:
            look = left_alone(type(env).observe)
            seen = {agent: look(env, agent) for agent in env.agents}
        else:
            seen = out[0]
        for agent, observation in seen.items():
            for value, bound in list(outside(env.observation_space(agent), observation)):
                for container in list(containers_of(env.unwrapped)):
                    set_in(container, value, bound)
        return out

    return _with_outputs(make, changed)


def orders_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Hands actions over in the order of possible_agents."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def step(self: Any, actions: Any) -> Any:
            names = [agent for agent in self.possible_agents if agent in actions]
            return cls.step(self, {agent: actions[agent] for agent in names})

        return {"step": step}

    return with_methods(make, methods)


def actions_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Hands a copy of each action to step."""

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        return {"step": lambda self, action: cls.step(self, copy.deepcopy(action))}

    return with_methods(make, methods)


def classes_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Puts an instance's own copy of what its classes keep in its place while it is called."""
    first: dict[Any, Any] = {}

    def put(kept: Any) -> None:
        for (owner, name), value in kept.items():
            put_back(owner, name, value)

    def kept_of(env: Any) -> dict[Any, Any]:
        return {(owner, name): value for owner, name, value in kept_by_classes(env)}

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def called(name: str) -> Callable[..., Any]:
            def call(self: Any, *args: Any, **kwargs: Any) -> Any:
                kept = self.__dict__.pop("own_of_class", None)
                if kept is None:  # within another call, or a copy made anew
                    return getattr(cls, name)(self, *args, **kwargs)
                put(kept)
                try:
                    return getattr(cls, name)(self, *args, **kwargs)
                finally:
                    self.__dict__["own_of_class"] = kept_of(self)

            return call

        names = "reset", "step", "observe", "state", "render", "last"
        return {name: called(name) for name in names if hasattr(cls, name)}

    def built() -> Any:
        put(copy.deepcopy(first))
        env = make()
        first.update(copy.deepcopy(kept_of(env)) if not first else {})
        env.__dict__["own_of_class"] = copy.deepcopy(kept_of(env))
        return env

    return with_methods(built, methods)


@dataclass(frozen=True, slots=True)
class Hold:
    """Holds one kind of cause still.

    Attributes:
        words: what is done, for `follows_from`.
        function: takes `make`, returns another.
        consequences: checks whose failure may follow from the cause, also one that a single episode
            shows; None: any, as one broken promise is repaired and all else is as it was.
        is_general: so may that of any check that compares two episodes.
    """

    words: str
    function: Callable[[Callable[[], Any]], Callable[[], Any]]
    consequences: tuple[str, ...] | None = None
    is_general: bool = False

    def explains(self, id: str, compares: bool) -> bool:
        """Tells whether a check's failure may follow: a program that passes with it shows that."""
        return self.names(id) or (self.is_general and compares)

    def names(self, id: str) -> bool:
        """Tells whether a check is among the consequences, whatever it looks at."""
        return self.consequences is None or id in self.consequences
