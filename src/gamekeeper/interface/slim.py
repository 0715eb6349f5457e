"""Environments as they ship, without the wrappers that make them slow.

PettingZoo documents a stack of wrappers, each of which hands every attribute through, and a
converter that computes an observation for each agent-step and drops it. Here one wrapper is around
the raw rules in their place, with the same promises and the same rows.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import wrappers
from pettingzoo.utils.conversions import aec_to_parallel_wrapper, parallel_to_aec_wrapper
from pettingzoo.utils.env_logger import EnvLogger

from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.object_source import class_name
from gamekeeper.interface.slim_aec import CLIP, REFUSE, Promises, SlimAEC, bounded
from gamekeeper.interface.to_aec import ToAEC
from gamekeeper.interface.to_parallel import Step, ToParallel, Totals

RANKS: Final = {
    wrappers.OrderEnforcingWrapper: 0,
    wrappers.AssertOutOfBoundsWrapper: 1,
    wrappers.ClipOutOfBoundsWrapper: 1,
    wrappers.TerminateIllegalWrapper: 2,
}
"""Wrappers in the order in which `SlimAEC` keeps their promises, from the outside inwards."""
PROMISED: Final = {
    "OrderEnforcingWrapper": "the order of calls",
    "AssertOutOfBoundsWrapper": "actions outside their space are refused",
    "ClipOutOfBoundsWrapper": "actions outside their space are clipped",
    "TerminateIllegalWrapper": "masked-out actions end the game with a penalty",
    "CaptureStdoutWrapper": "what is printed is the picture",
    "aec_to_parallel_wrapper": "all agents at once",
    "parallel_to_aec_wrapper": "one agent after the other",
}


def slim(env: Any) -> Any:
    """The same environment with one wrapper in the place of PettingZoo's wrappers and converters.

    Every row is what the environment as shipped gives, bit for bit; where nothing can be replaced,
    it is handed back as it is. Only wrappers of exactly PettingZoo's own classes are replaced, from
    the outside inwards up to the first other one, which stays with all that is inside it.

    Args:
        env: a new environment: one that is running would have to be reset first.
    """
    if type(env) is aec_to_parallel_wrapper:
        return SlimParallel(slim(env.aec_env))
    if not isinstance(env, AECEnv):
        return env
    core, promises, replaced = _peeled(env)
    is_plain = promises.penalty is None and not promises.captures
    if type(core) is parallel_to_aec_wrapper and is_plain:
        return SlimToAEC(core.env, promises, (*replaced, parallel_to_aec_wrapper.__name__))
    return SlimAEC(core, promises, replaced) if replaced else env


def described_slim(env: Any) -> tuple[str, ...]:
    """Lines that tell what `slim` replaced in an environment, or would replace, and what stays."""
    made = slim(env)
    replaced: tuple[str, ...] = getattr(made, "replaced", ())
    lines = [f"replaced: {name} ({PROMISED[name]})" for name in replaced] or ["replaced: nothing"]
    inside = made
    while type(inside) in SLIM_CLASSES:
        inside = inside.env
    while inside is not inside.unwrapped and hasattr(inside, "env"):
        lines.append(f"stays: {class_name(type(inside))}")
        inside = inside.env
    rules = type(inside.unwrapped)
    return (*lines, f"environment: {class_name(rules)}")


def _peeled(env: Any) -> tuple[Any, Promises, tuple[str, ...]]:
    """Environment inside the known wrappers in their usual order, and what they promise."""
    names: list[str] = []
    order, bounds, penalty, captures, rank = False, None, None, False, -1
    while True:
        kind = type(env)
        if kind is wrappers.CaptureStdoutWrapper and not captures:
            captures = True
        elif RANKS.get(kind, -1) > rank:
            rank = RANKS[kind]
            if kind is wrappers.OrderEnforcingWrapper:
                order = True
            elif kind is wrappers.TerminateIllegalWrapper:
                penalty = env._illegal_value
            else:
                bounds = CLIP if kind is wrappers.ClipOutOfBoundsWrapper else REFUSE
        elif kind is not wrappers.BaseWrapper:
            break
        names.append(kind.__name__)
        env = env.env
    promises = Promises(order=order, bounds=bounds, penalty=penalty, captures=captures)
    return env, promises, tuple(names)


class SlimToAEC(ToAEC):
    """A Parallel environment in the place of what `parallel_to_aec` and its wrappers made of it.

    The law of `ToAEC`, and: who ended leaves in the order of the names; the environment gets
    actions in the order in which agents came, whatever its roster does; they are looked at as the
    wrappers did, so not at all where there were none for it.
    """

    def __init__(
        self, env: ParallelEnv[Any, Any, Any], promises: Promises, replaced: tuple[str, ...]
    ) -> None:
        super().__init__(env)
        if hasattr(self, "terms"):  # the converter doesn't tell reward terms
            del self.terms
        self.promises, self.replaced = promises, replaced
        self._came: dict[Any, None] = {}

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begins an episode."""
        super().reset(seed, options)
        self._came = dict.fromkeys(self.agents)

    def step(self, action: Any) -> None:
        """Plays one turn; after the end it is logged and does nothing, as it was."""
        if getattr(self, "agents", None) == []:
            EnvLogger.warn_step_after_terminated_truncated()
            return
        super().step(action)

    def _judge(self, agent: AgentId, action: Any) -> tuple[bool, Any]:
        """The action, after the wrappers' check of its bounds."""
        bounds = self.promises.bounds
        return True, action if bounds is None else bounded(self, agent, action, bounds)

    def _handed(self, acts: dict[Any, Any]) -> dict[Any, Any]:
        """The actions, in the order in which the agents came."""
        self._came = dict.fromkeys(agent for agent in (*self._came, *acts) if agent in acts)
        return {agent: acts[agent] for agent in self._came}

    def _leaving(self, ended: list[Any]) -> list[Any]:
        """Those who ended, by their names."""
        return sorted(ended, key=str)


class SlimParallel(ToParallel):
    """An AEC environment in the place of what `aec_to_parallel` made of it.

    The law of `ToParallel`, and: everybody is shown what is there before those who ended leave;
    actions are looked at one by one, by the environment inside, and those of nobody live not at
    all.
    """

    def __init__(self, env: AECEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        if self._rewards.has_terms:  # the converter doesn't tell reward terms
            self._rewards.has_terms = False
            del self.terms
        self.replaced = (aec_to_parallel_wrapper.__name__, *getattr(env, "replaced", ()))
        self._shown: dict[Any, Any] = {}

    @property
    def aec_env(self) -> AECEnv[Any, Any, Any]:
        """The environment inside, by the name that the converter gave it."""
        return self.env

    def step(self, actions: Mapping[Any, Any]) -> Step:
        """Plays one tick: observations, rewards, terminations, truncations, infos."""
        observations, rewards, terminations, truncations, infos = super().step(actions)
        # the converter adds to 0, which makes 0.0 of -0.0
        added = {agent: 0 + reward for agent, reward in rewards.items()}
        return observations, added, terminations, truncations, infos

    def _check(self, actions: Mapping[Any, Any]) -> None:
        """The environment inside looks at each action as it comes."""

    def _outputs(self, totals: Totals | None) -> Step:
        """Looks up every agent's observation before the None turns."""
        self._shown = super()._observations(list(self._books.agents))
        try:
            return super()._outputs(totals)
        finally:
            self._shown = {}

    def _observations(self, agents: Iterable[Any]) -> dict[Any, Any]:
        shown = self._shown
        if not shown:
            return super()._observations(agents)
        return {agent: shown[agent] for agent in agents}


SLIM_CLASSES: Final = (SlimAEC, SlimToAEC, SlimParallel)
