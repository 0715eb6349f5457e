"""One wrapper in the place of the wrappers that AEC environments ship in."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import AECEnv
from pettingzoo.utils.capture_stdout import capture_stdout
from pettingzoo.utils.env_logger import EnvLogger

from gamekeeper.errors import ActionError, OrderError
from gamekeeper.interface.author_calls import AgentId, loop_without_step
from gamekeeper.interface.env_inside import EnvInside, handed_on
from gamekeeper.interface.legality import learn_ranges, refused

REFUSE: Final = "refuse"
CLIP: Final = "clip"
MASK: Final = "action_mask"
BOOKS: Final = ("agents", "agent_selection", "rewards", "terminations", "truncations", "infos")
GUARDED: Final = frozenset({*BOOKS, "num_agents"})  # refused before a reset


class CallError(OrderError, AssertionError):
    """A call came before `reset`; an AssertionError too, as the wrapper's own refusal is one."""


class BoundsError(ActionError, AssertionError):
    """An action is outside its space; an AssertionError too, as the wrapper's refusal is one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Promises:
    """Promises that a stack of PettingZoo's wrappers makes for the environment inside it.

    Args:
        order: calls before `reset` are refused, and a loop over `agent_iter` without a step.
        bounds: an action outside its space is refused (`refuse`), clipped (`clip`), or not looked
            at (None).
        penalty: what a masked-out action is paid, and it ends the game; None: masks aren't read.
        captures: `render` returns what the environment prints.
    """

    order: bool = False
    bounds: str | None = None
    penalty: float | None = None
    captures: bool = False


class SlimAEC(EnvInside, AECEnv[Any, Any, Any]):
    """An AEC environment whose wrappers' promises are kept in one place.

    The law: every book, observation, reward and frame is what the stack of wrappers would show, an
    action that it would refuse is refused, and its warnings are logged. What the wrappers hand
    through is handed through: public attributes of the environment, and no private ones.
    """

    def __init__(
        self, env: AECEnv[Any, Any, Any], promises: Promises, replaced: tuple[str, ...] = ()
    ) -> None:
        super().__init__()
        self.env = env
        self.promises, self.replaced = promises, replaced
        if promises.captures:
            self.render_mode = "ansi"
        self._is_ready = not promises.order
        self._has_stepped = False
        self._was_illegal = False  # the game was ended by a masked-out action
        self._seen: Any = None  # what the agent in turn was shown since the last step
        self._seen_info: Any = None
        self._spaces: dict[Any, Space[Any]] = {}
        self._ranges: dict[Any, range] = {}

    def __getattr__(self, name: str) -> Any:
        if name in GUARDED and not self._is_ready:
            raise _too_early(name)
        if name.startswith("_") or name == "env":
            raise AttributeError(f"private attribute '{name}' stays with the environment inside")
        return getattr(self.env, name)

    observation_spaces = handed_on("env.observation_spaces")
    action_spaces = handed_on("env.action_spaces")
    _cumulative_rewards = handed_on("env._cumulative_rewards")

    def state(self) -> Any:
        """The environment's own state."""
        self._check_call("state")
        return self.env.state()

    def render(self) -> Any:
        """The environment's own picture, or what it prints where the stack captured that."""
        self._check_call("render")
        if not self.promises.captures:
            return self.env.render()
        with capture_stdout() as printed:
            self.env.render()
            return printed.getvalue()

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begins an episode."""
        self._is_ready = self._has_stepped = True
        self._was_illegal, self._seen = False, None
        self._spaces.clear()
        self._ranges.clear()
        self.env.reset(seed=seed, options=options)

    def observe(self, agent: AgentId) -> Any:
        """Observation that the environment shows an agent."""
        if not self._is_ready:
            raise _too_early("observe")
        env = self.env
        seen = env.observe(agent)
        if self.promises.penalty is not None and agent == env.agent_selection:
            self._seen, self._seen_info = seen, env.infos.get(agent, {})
        return seen

    def last(self, observe: bool = True) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Observation, cumulative reward, flags and info of the agent in turn."""
        if not self._is_ready:
            raise _too_early("last")
        env = self.env
        agent = env.agent_selection
        return (
            self.observe(agent) if observe else None,
            env._cumulative_rewards[agent],
            env.terminations[agent],
            env.truncations[agent],
            env.infos[agent],
        )

    def step(self, action: Any) -> None:
        """Plays one turn of the agent in turn.

        Raises:
            OrderError: there was no reset.
            ActionError: the action is outside its space, where the stack looked at that.
        """
        env, promises = self.env, self.promises
        if promises.order:
            if not self._is_ready:
                raise _too_early("step")
            self._has_stepped = True
            if not env.agents:
                EnvLogger.warn_step_after_terminated_truncated()
                return
        agent = env.agent_selection
        if type(action) is not int or action not in self._range_of(agent):
            action = self._bounded(agent, action)
        if promises.penalty is None:
            env.step(action)
        else:
            self._step_judged(agent, action, promises.penalty)

    def agent_iter(self, max_iter: int = 2**63) -> Iterator[Any]:
        """The agents in the order of their turns.

        Raises:
            OrderError: there was no reset; or the loop went round without a step.
        """
        if not self.promises.order:
            return iter(self.env.agent_iter(max_iter))
        self._check_call("agent_iter")
        return self._turns_to_come(max_iter)

    def _turns_to_come(self, left: int) -> Iterator[Any]:
        env = self.env
        while left > 0 and env.agents:
            if not self._has_stepped:
                raise loop_without_step(CallError)
            self._has_stepped = False
            left -= 1
            yield env.agent_selection

    # -- what the wrappers did

    def _range_of(self, agent: AgentId) -> range:
        """The whole numbers that need no further look; spaces are read again in each episode."""
        try:
            return self._ranges[agent]
        except KeyError:
            learn_ranges((agent,), self.env.action_space, self._spaces, self._ranges)
            return self._ranges[agent]

    def _bounded(self, agent: AgentId, action: Any) -> Any:
        """The action that is played, as the wrapper for bounds would hand it on."""
        bounds = self.promises.bounds
        if isinstance(action, np.integer) and int(action) in self._range_of(agent):
            return action
        return action if bounds is None else bounded(self.env, agent, action, bounds)

    def _step_judged(self, agent: AgentId, action: Any, penalty: float) -> None:
        """One turn, or the end of the game where the mask says that the action isn't legal."""
        env = self.env
        if env.terminations[agent] or env.truncations[agent]:
            self._seen = None
            # After a forfeit the environment's own step may not look for an end: the books play it.
            (env.unwrapped._was_dead_step if self._was_illegal else env.step)(action)
            return
        if self._seen is None:
            self.observe(agent)
        holder = self._seen if isinstance(self._seen, dict) else self._seen_info
        self._seen = None
        if MASK not in holder:
            raise AssertionError(  # as the wrapper says it
                f"`{MASK}` must be in `observation['{MASK}']` or `info['{MASK}']`: {holder}"
            )
        if holder[MASK][action]:
            env.step(action)
            return
        EnvLogger.warn_on_illegal_move()
        # What TerminateIllegalWrapper writes into the books, in its order.
        raw, agents = env.unwrapped, env.agents
        raw._cumulative_rewards[agent] = 0
        raw.terminations = dict.fromkeys(agents, True)
        raw.truncations = dict.fromkeys(agents, True)
        raw.rewards = {**dict.fromkeys(agents, 0), agent: float(penalty)}
        raw._accumulate_rewards()
        raw._deads_step_first()
        self._was_illegal = True

    def _check_call(self, call: str) -> None:
        if not self._is_ready:
            raise _too_early(call)


def bounded(env: Any, agent: AgentId, action: Any, bounds: str) -> Any:
    """The action that is played, as PettingZoo's wrapper for bounds would hand it on.

    Raises:
        BoundsError: it is outside its space, and isn't to be clipped or can't be.
    """
    space = env.action_space(agent)
    if bounds == CLIP:
        return action if action is None else _clipped(space, action)
    if action is None and (env.terminations[agent] or env.truncations[agent]):
        return action
    if not space.contains(action):
        raise BoundsError(**refused(agent, action, space).parts())
    return action


def _clipped(space: Any, action: Any) -> Any:
    """The action, brought into its space with a warning where it isn't in it."""
    if space.contains(action):
        return action
    if np.isnan(action).any():
        EnvLogger.error_nan_action()
    if space.shape != action.shape:
        raise BoundsError(
            "an action has another shape than its space",
            where="step",
            expected=f"shape {space.shape}",
            actual=f"shape {action.shape}",
        )
    EnvLogger.warn_action_out_of_bound(
        action=action, action_space=space, backup_policy="clipping to space"
    )
    return np.clip(action, space.low, space.high)


def _too_early(call: str) -> CallError:
    return CallError(f"{call} came before reset()", where=call, fix="call reset() first")


def _book(name: str) -> property:
    """A property that hands out one of the environment's own books, once there was a reset."""

    def read(wrapped: SlimAEC) -> Any:
        if not wrapped._is_ready:
            raise _too_early(name)
        return getattr(wrapped.env, name)

    return property(read, doc=f"The environment's own `{name}`.")


for _name in BOOKS:
    setattr(SlimAEC, _name, _book(_name))
