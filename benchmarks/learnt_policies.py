"""Learnt policies with one fault, for benchmarks/learnt.py: what people report of trained agents.

Normalization that was left out, weights that weren't loaded for one agent, a temperature, actions
that come late or are held, fields in another order, a sensor or an actuator turned round or in
other units. Nothing here uses the diagnosis' own code.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import undo_causes
from gymnasium.spaces import Box, Discrete
from learnt_envs import Lanterns, Plots
from undo_causes import Faulty, mirrored, renamed, scaled, swapped

FAILED = {"plots": "ending != 'harvested'", "lanterns": "ending != 'hung'"}
CLIP, TINY = 10.0, 1e-8
"""As SB3's VecNormalize has them."""


class Network:
    """The policy network of an SB3 model, and the statistics of its observations, as arrays."""

    def __init__(self, kept: Mapping[str, Any], *, is_normalized: bool = True) -> None:
        """Reads it."""
        self.layers = [
            (np.asarray(kept[f"weight_{k}"], np.float64), np.asarray(kept[f"bias_{k}"]))
            for k in range(sum(name.startswith("weight") for name in kept))
        ]
        self.mean, self.spread = kept["mean"], np.sqrt(kept["variance"] + TINY)
        self.is_normalized = is_normalized

    def numbers(self, observation: Any) -> Any:
        """What the last layer gives: logits, or the mean of an action."""
        row = np.asarray(observation, np.float64)
        if self.is_normalized:
            row = np.clip((row - self.mean) / self.spread, -CLIP, CLIP)
        for weight, bias in self.layers[:-1]:
            row = np.tanh(weight @ row + bias)
        weight, bias = self.layers[-1]
        return weight @ row + bias

    def act(self, observation: Any, space: Any) -> Any:
        """The likeliest action."""
        numbers = self.numbers(observation)
        if isinstance(space, Discrete):
            return int(np.argmax(numbers))
        return np.clip(numbers, space.low, space.high).astype(np.float32)


class Tempered:
    """A learnt policy that draws its actions, at a temperature."""

    def __init__(self, network: Network, temperature: float) -> None:
        """Plants it."""
        self.network, self.temperature = network, temperature

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> Any:
        """The action."""
        numbers = self.network.numbers(observation)
        if len(numbers) == 2:  # a force
            drawn = numbers + self.temperature * rng.normal(0.0, 1.0, 2)
            return np.clip(drawn, -1, 1).astype(np.float32)
        weights = np.exp((numbers - numbers.max()) / self.temperature)
        return int(rng.choice(len(numbers), p=weights / weights.sum()))


@dataclass(frozen=True)
class LearntCause:
    """A set-up of learnt policies, and what is wrong with it.

    Attributes:
        name: what it is.
        env, failed: the environment, and the condition of a failed episode.
        policies: by agent.
        sound: the policy without a fault.
        agents: whose fault it is; none: healthy.
        labels: what it may be called; none: no boundary shows it.
        is_restored: a peer's policy or an undo from outside restores it.
    """

    name: str
    env: Any
    failed: str
    policies: dict[str, Any]
    sound: Any
    agents: tuple[str, ...]
    labels: tuple[str, ...]
    is_restored: bool


P, C, T = ("perception",), ("control",), ("timing",)
FORCE = Box(-1, 1, (2,), np.float32)
ENVS: dict[str, tuple[Any, tuple[str, ...], Any]] = {
    "plots": (Plots, ("harvester_0", "harvester_1"), Discrete(5)),
    "lanterns": (Lanterns, ("lantern_0", "lantern_1", "lantern_2"), FORCE),
}
FAULTS: dict[str, list[tuple[str, tuple[str, ...], dict[str, Any]]]] = {
    "plots": [
        ("fields 0 and 1 exchanged", P, {"sees": swapped(0, 1)}),
        ("place and plot exchanged", P, {"sees": lambda x: np.asarray(x)[[2, 3, 0, 1, 4]]}),
        ("field 2 turned round", P, {"sees": mirrored(2, 100)}),
        ("acts 8 turns late", T, {"lag": 8}),
        ("chooses every 12th turn", T, {"every": 12}),
        ("actions 1 and 2 exchanged", C, {"does": renamed(1, 2)}),
        ("actions 1 and 3 exchanged", C, {"does": renamed(1, 3)}),
    ],
    "lanterns": [
        ("fields 2 and 3 exchanged", P, {"sees": swapped(2, 3)}),
        ("field 1 turned round", P, {"sees": mirrored(1, 0)}),
        ("centimetres for metres", P, {"sees": scaled(100.0)}),
        ("acts 7 turns late", T, {"lag": 7}),
        ("axes exchanged", C, {"does": swapped(0, 1)}),
        ("a tenth of the force", C, {"does": scaled(0.1)}),
        ("axis 0 turned round", C, {"does": mirrored(0, 0)}),
    ],
}
HARMLESS: list[dict[str, Any]] = [{}, {"lag": 1}, {"every": 2}, {"noise": 0.005}]
WHOM = {"plots": (0, 1), "lanterns": (0, 2)}


def causes(folder: Path) -> Iterator[LearntCause]:
    """All set-ups, from the arrays that learnt_training.py wrote."""
    for name, (env, agents, space) in ENVS.items():
        learnt, none = (np.load(folder / f"{name}-{kind}.npz") for kind in ("learnt", "untrained"))
        network = Network(learnt)
        sound = _acts(network, space)

        def cause(
            text: str,
            changed: dict[str, Any],
            labels: tuple[str, ...] = (),
            *,
            is_healthy: bool = False,
            name: str = name,
            env: Any = env,
            sound: Any = sound,
            everyone: tuple[str, ...] = agents,
        ) -> LearntCause:
            whose = () if is_healthy else tuple(changed)
            policies = {agent: Faulty(sound) for agent in everyone} | changed
            title = f"{name}: {' and '.join(changed)} {text}"
            is_restored = not is_healthy and len(whose) < len(everyone)
            return LearntCause(
                title, env, FAILED[name], policies, sound, whose, labels, is_restored
            )

        raw = _acts(Network(learnt, is_normalized=False), space)
        for agent in (agents[k] for k in WHOM[name]):
            yield cause("isn't normalized", {agent: Faulty(raw)}, P)
            yield cause("has no weights", {agent: Faulty(_acts(Network(none), space))})
            hot = 30.0 if name == "plots" else 3.0
            yield cause("is drawn hot", {agent: Tempered(network, hot)})
            for text, labels, arguments in FAULTS[name]:
                yield cause(text, {agent: Faulty(sound, **arguments)}, labels)
            for number, arguments in enumerate(HARMLESS):
                text = f"harmless {number}"
                yield cause(text, {agent: Faulty(sound, **arguments)}, is_healthy=True)
        yield cause("aren't normalized", {agent: Faulty(raw) for agent in agents}, P)
        untrained = _acts(Network(none), space)
        yield cause("have no weights", {agent: Faulty(untrained) for agent in agents})


def _acts(network: Network, space: Any) -> Any:
    return lambda observation, agent: network.act(observation, space)


def holds(cause: LearntCause) -> bool:
    """Tells whether a set-up is what it claims to be, by the rule of undo_causes.py."""
    count, most = _successes(cause, cause.policies), undo_causes.EPISODES
    if not cause.agents:
        return count >= most - 2
    sound = {agent: Faulty(cause.sound) for agent in cause.policies}
    return count <= most // 2 and _successes(cause, sound) >= most - 2


def _successes(cause: LearntCause, policies: Any) -> int:
    of = undo_causes.Planted("", cause.env, policies, cause.failed, (), (), "")
    return undo_causes.successes(of)
