"""Set-ups with a planted cause of failure, and healthy ones, made without the diagnosis' own code.

A set-up is a task, its arguments and its policies, with one thing wrong (or two, or one that has no
handle), beside things that are wrong and harmless. What is wrong is known by construction; that it
is so is looked at by plain rollouts on seeds of their own, by this rule, stated beforehand:

- *failing*: it succeeds in at most half of 24 episodes, and in 23 or more without what is wrong;
- *single*: as above. *joint*: besides, without either planted cause alone in at most half;
- *no handle*: it succeeds in at most half, also with every knob at its ideal;
- *healthy*: it succeeds in at least 23 of 24.

Set-ups that don't come out so are none, and others are drawn until there are enough.
"""

import itertools
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import gamekeeper as gk

EPISODES = 24
SEED = 777_000

BASES: dict[str, dict[str, Any]] = {
    "handover": {},
    "two_robot_line": {"n": 31},
    "warehouse": {"pickers": 2, "carriers": 1, "spares": 0, "orders": 3},
    "warehouse_turns": {"pickers": 2, "carriers": 1, "spares": 0, "orders": 3},
}
AGENTS = {
    "handover": ("giver_0", "receiver_0"),
    "two_robot_line": ("picker", "carrier"),
    "warehouse": ("carrier_0", "picker"),
    "warehouse_turns": ("carrier_0", "picker"),
}
"""Whom a knob may be set for; both pickers of a warehouse, as the other one would do the work."""
FAILED = {"two_robot_line": "length > 24"}
"""Conditions in place of the contract's: two robots on a line meet late rather than never."""
LABELS = {
    "observation_noise": "perception",
    "occlusion": "perception",
    "observation_delay": "perception",
    "odometry_drift": "state estimation",
    "actuator_slip": "control",
    "actuator_dropout": "control",
    "latency": "timing",
    "slowness": "timing",
    "held_out": "data coverage",
}
STRONG: dict[str, tuple[float, ...]] = {
    "observation_noise": (2.0, 4.0),
    "occlusion": (0.8, 0.95),
    "observation_delay": (4, 9),
    "odometry_drift": (0.3, 0.6),
    "actuator_slip": (0.6, 0.9),
    "actuator_dropout": (0.8, 0.95),
    "latency": (3, 8),
    "slowness": (5, 12),
    "held_out": (1.0,),
}
WEAK: dict[str, float] = {
    "observation_noise": 0.05,
    "occlusion": 0.03,
    "odometry_drift": 0.002,
    "actuator_slip": 0.01,
    "actuator_dropout": 0.02,
    "held_out": 0.1,
}
WORSE = ("noop", "random", "lazy", "greedy")
SHORT = {"handover": 25, "two_robot_line": 9, "warehouse": 25, "warehouse_turns": 60}
"""Horizons in which the task can't be done."""


@dataclass(frozen=True)
class Planted:
    """A set-up and what is wrong with it.

    Attributes:
        task, kwargs, policies: what is played.
        cures: by label, what undoes it: `kwargs` or `policies` that go on top.
        agents: whose cause it is; empty: everybody's.
        kind: `single`, `joint`, `no handle` or `healthy`.
        most_turns: episodes are cut there.
    """

    task: str
    kwargs: dict[str, Any]
    kind: str
    policies: dict[str, str] = field(default_factory=dict)
    cures: dict[str, dict[str, Any]] = field(default_factory=dict)
    agents: tuple[str, ...] = ()
    most_turns: int | None = None

    @property
    def failed(self) -> str | None:
        """The condition that is handed over, if the contract's isn't meant."""
        return FAILED.get(self.task)

    def told(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "task": self.task,
            "kind": self.kind,
            "labels": list(self.cures),
            "kwargs": {k: v for k, v in self.kwargs.items() if k not in BASES[self.task]},
            "policies": self.policies,
            "agents": list(self.agents),
            "most_turns": self.most_turns,
        }


def drawn(kind: str, seed: int) -> Iterator[Planted]:
    """Set-ups of a kind without end, the cells of task and label in turn."""
    rng = random.Random(f"{kind} {seed}")
    makers = {"single": _singles, "joint": _joints, "no handle": _lost, "healthy": _healthy}
    while True:
        yield from makers[kind](rng)


def _setting(rng: random.Random, task: str, value: Any) -> tuple[Any, tuple[str, ...]]:
    """A knob's setting for one agent or role, or for everybody."""
    whom = rng.choice((*AGENTS[task], ""))
    return ({whom: value}, (whom,)) if whom else (value, ())


def _decoys(rng: random.Random, task: str, but: tuple[str, ...], most: int = 2) -> dict[str, Any]:
    """Knobs that are turned and do no harm."""
    known = [k for k in WEAK if k not in but and (task != "two_robot_line" or k != "occlusion")]
    return {name: WEAK[name] for name in rng.sample(known, rng.randint(0, most))}


def _knobs(task: str) -> list[str]:
    return [name for name in STRONG if task != "two_robot_line" or name != "occlusion"]


def _singles(rng: random.Random) -> Iterator[Planted]:
    for task in BASES:
        for name in _knobs(task):
            value = rng.choice(STRONG[name])
            setting, whom = (value, ()) if name == "held_out" else _setting(rng, task, value)
            kwargs = {**BASES[task], **_decoys(rng, task, (name,)), name: setting}
            yield Planted(
                task, kwargs, "single", cures={LABELS[name]: {"kwargs": {name: 0}}}, agents=whom
            )
        whom = rng.choice(AGENTS[task])
        yield Planted(
            task,
            {**BASES[task], **_decoys(rng, task, ())},
            "single",
            policies={whom: rng.choice(WORSE)},
            agents=(whom,),
            cures={"policy": {"policies": {whom: "reference"}}},
        )
        kwargs = {**BASES[task], **_decoys(rng, task, ())}
        if task != "two_robot_line" and rng.random() < 0.5:
            short = {"horizon": SHORT[task]}
            cure = {
                "evaluation": {"kwargs": {"horizon": 1000 if task == "warehouse_turns" else 400}}
            }
            yield Planted(task, {**kwargs, **short}, "single", cures=cure)
        elif task != "two_robot_line":
            cure = {"evaluation": {"most_turns": None}}
            yield Planted(task, kwargs, "single", cures=cure, most_turns=SHORT[task])


def _joints(rng: random.Random) -> Iterator[Planted]:
    for task in BASES:
        pairs = [
            (one, two)
            for one, two in itertools.combinations(_knobs(task), 2)
            if LABELS[one] != LABELS[two] and "held_out" not in (one, two)
        ]
        one, two = rng.choice(pairs)
        settings = {name: _setting(rng, task, STRONG[name][-1]) for name in (one, two)}
        kwargs = {**BASES[task], **_decoys(rng, task, (one, two), 1)}
        kwargs |= {name: setting for name, (setting, _) in settings.items()}
        named = [agents for _, agents in settings.values()]
        whom = tuple(dict.fromkeys(a for agents in named for a in agents)) if all(named) else ()
        yield Planted(
            task,
            kwargs,
            "joint",
            cures={LABELS[name]: {"kwargs": {name: 0}} for name in (one, two)},
            agents=whom,
        )


def _lost(rng: random.Random) -> Iterator[Planted]:
    """Tasks that are made too hard by arguments that no contract calls a knob."""
    hard = {
        "handover": {"gap": 400},
        "two_robot_line": {"n": 200},
        "warehouse": {"battery": 12},
        "warehouse_turns": {"battery": 12},
    }
    for task, arguments in hard.items():
        yield Planted(task, {**BASES[task], **arguments, **_decoys(rng, task, ())}, "no handle")


def _healthy(rng: random.Random) -> Iterator[Planted]:
    for task in BASES:
        kwargs = {**BASES[task], **_decoys(rng, task, (), 4)}
        policies = {rng.choice(AGENTS[task]): "greedy"} if rng.random() < 0.3 else {}
        yield Planted(task, kwargs, "healthy", policies=policies)


def rollout(planted: Planted, *, seed: int, episodes: int, **changed: Any) -> Any:
    """Evidence of a set-up, with something on top of it."""
    return gk.rollout(
        planted.task,
        episodes=episodes,
        seed=seed,
        policies={"*": "reference", **planted.policies, **changed.get("policies", {})},
        env_kwargs={**planted.kwargs, **changed.get("kwargs", {})},
        most_turns=changed.get("most_turns", planted.most_turns),
    )


def success(planted: Planted, **changed: Any) -> float:
    """The share of episodes that don't fail, by plain rollouts on seeds of their own."""
    evidence = rollout(planted, seed=SEED, episodes=EPISODES, **changed)
    good = 0
    for episode in evidence.episodes:
        if planted.task == "two_robot_line":
            good += int(episode.header["turns"]) <= 24
        elif planted.task == "handover":
            good += set(episode.endings.values()) == {"done"}
        else:
            good += set(episode.endings.values()) == {"cleared"}
    return good / EPISODES


def holds(planted: Planted) -> dict[str, float] | None:
    """The shares of successes by which a set-up is what it claims to be; None where it isn't."""
    shares = {"as it is": success(planted)}
    if planted.kind == "healthy":
        return shares if shares["as it is"] >= 23 / 24 else None
    if shares["as it is"] > 0.5:
        return None
    if planted.kind == "no handle":
        off = {name: 0 for name in planted.kwargs if name in LABELS}
        shares["knobs off"] = success(planted, kwargs=off) if off else shares["as it is"]
        return shares if shares["knobs off"] <= 0.5 else None
    every: dict[str, Any] = {}
    for label, cure in planted.cures.items():
        for key, value in cure.items():
            every[key] = {**every.get(key, {}), **value} if isinstance(value, dict) else value
        if planted.kind == "joint":
            shares[label] = success(planted, **cure)
            if shares[label] > 0.5:
                return None
    shares["cured"] = success(planted, **every)
    return shares if shares["cured"] >= 23 / 24 else None
