"""One episode played for what it comes to, without recording it: about half the cost."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import Outcome, plain_numbers
from gamekeeper.interface.parallel_capture import ParallelCapture
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.rollouts.episode_loop import (
    ActionChooser,
    Actions,
    EpisodeLoop,
    EpisodePlan,
    FailedCall,
    nothing,
)
from gamekeeper.rollouts.intervention import Hooks, Intervention


def tally(
    play: EpisodePlan,
    env: Any,
    *,
    contract: Contract | None = None,
    change: Intervention | None = None,
    joint_policy: ActionChooser | None = None,
    policy_seed: int = 0,
    on_step: Callable[[], None] | None = None,
) -> Outcome:
    """Plays one episode in `env` and counts; nothing of it is kept but the figures.

    The arguments are those of `perform`, and so is what is played.

    Raises:
        GamekeeperError: Gamekeeper itself can't go on.
    """
    hooks = Hooks() if change is None else change.start(np.random.default_rng([7, play.stream]))
    episode = TalliedEpisode(
        play,
        env,
        hooks,
        contract=contract,
        joint_policy=joint_policy,
        policy_seed=policy_seed,
        on_step=on_step,
    )
    try:
        episode.run()
    finally:
        hooks.after(env)
    return episode.outcome()


class TalliedEpisode:
    """An episode under way of which only the figures are kept; a deep copy of it goes on alone.

    Attributes:
        count: the figures so far.
        failed: the call that raised, if one did.
    """

    def __init__(
        self,
        play: EpisodePlan,
        env: Any,
        hooks: Hooks,
        *,
        contract: Contract | None = None,
        joint_policy: ActionChooser | None = None,
        policy_seed: int = 0,
        on_step: Callable[[], None] | None = None,
        sink: Any = None,
    ) -> None:
        """Takes hold of `env`; nothing is played yet. The arguments are those of `tally`.

        Args:
            sink: takes the rows as well, where one is given.
        """
        self.capture, self.joint_policy, self._play = capture_of(env, sink=sink), joint_policy, play
        volatile = () if contract is None else contract.volatile_infos()
        is_parallel = isinstance(self.capture, ParallelCapture)
        self.count = _Ticks(volatile) if is_parallel else _TurnTally(volatile)
        self._loop = EpisodeLoop(
            play, self.capture, joint_policy, hooks, self.count, on_step or nothing, contract
        )
        self.failed: FailedCall | None = None
        if joint_policy is not None and play.actions is None:
            joint_policy.begin(policy_seed, play.stream)

    @property
    def turns(self) -> int:
        """Env steps so far."""
        return len(self._loop.taken) if self.failed is None else self.failed.turn

    @property
    def taken(self) -> Sequence[Actions]:
        """Actions of each env step so far."""
        return self._loop.taken

    def run(self, until: int | None = None) -> None:
        """Plays on, to the end or until so many turns of the episode were played."""
        self.failed = self._loop.run(until)

    def outcome(self) -> Outcome:
        """Outcome of the episode, as far as it was played."""
        failed, capture = self.failed, self.capture
        is_over = failed is None and not capture.to_move
        error = None if failed is None else failed.said
        return self.count.outcome(
            self._play.seed, capture.env, self.turns, is_over=is_over, error=error
        )


class _Count:
    """Adds up what a capture gives, as a watch over the loop of an episode."""

    def __init__(self, volatile: Any) -> None:
        self._volatile = volatile
        self.returns: dict[Any, float] = {}
        self.terms: dict[Any, dict[str, float]] = {}
        self.ended: dict[Any, str] = {}
        self.infos: dict[Any, Any] = {}
        self.seen: dict[Any, int] = {}

    def begin(self, env: Any) -> None:
        """Starts an episode: all sums are 0, and reward terms are known to exist."""
        self.returns.update(dict.fromkeys(env.agents, 0.0))
        if isinstance(getattr(env, "terms", None), dict):
            self.terms.update({agent: {} for agent in env.agents})

    def take_terms(self, env: Any) -> None:
        """Takes the last step's rewards by term, where the environment reports them."""
        paid = getattr(env, "terms", None)
        if not isinstance(paid, dict):
            return
        for agent, terms in paid.items():
            mine = self.terms.setdefault(agent, {})
            for name, value in terms.items():
                mine[name] = mine.get(name, 0.0) + value

    def outcome(
        self, seed: int | None, env: Any, turns: int, *, is_over: bool, error: str | None
    ) -> Outcome:
        """Outcome of the episode."""
        named = getattr(env.unwrapped, "endings", None)
        reasons = named if isinstance(named, dict) else {}
        ends = {a: str(reasons.get(a) or self.ended.get(a, "cut")) for a in self.returns}
        infos = {a: numbers for a, info in self.infos.items() if (numbers := self._numbers(info))}
        return Outcome(
            seed=seed,
            turns=turns,
            returns={agent_name(agent): float(value) for agent, value in self.returns.items()},
            terms={agent_name(agent): dict(terms) for agent, terms in self.terms.items()},
            endings={agent_name(agent): end for agent, end in ends.items()},
            infos={agent_name(agent): numbers for agent, numbers in infos.items()},
            seen={agent_name(agent): self.seen[agent] for agent in infos},
            flags={str(agent): self.ended.get(agent, "cut") for agent in self.returns},
            is_over=is_over,
            error=error,
        )

    def _numbers(self, info: Any) -> dict[str, float]:
        found = plain_numbers(info)
        return {key: value for key, value in found.items() if key not in self._volatile}


class _Ticks(_Count):
    """Tally of a Parallel environment."""

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """Adds a tick."""
        if turn == 0:
            self._take_infos(0, out[1])
            self.begin(env)
            return
        _, rewards, terms, truncs, infos = out
        for agent, reward in rewards.items():
            self.returns[agent] = self.returns.get(agent, 0.0) + reward
        for flags, word in ((truncs, "truncated"), (terms, "terminated")):
            self.ended.update({agent: word for agent, flag in flags.items() if flag})
        self._take_infos(turn, infos)
        self.take_terms(env)

    def _take_infos(self, turn: int, infos: Any) -> None:
        self.infos.update(infos)
        self.seen.update(dict.fromkeys(infos, turn))


class _TurnTally(_Count):
    """Tally of an AEC environment: rewards since an agent acted count when it is in turn."""

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """Adds a turn."""
        if turn == 0:
            self.begin(env)
        else:
            self.take_terms(env)
        if not env.agents:
            return
        agent = env.agent_selection
        self.returns[agent] = self.returns.get(agent, 0.0) + env._cumulative_rewards[agent]
        if env.terminations[agent] or env.truncations[agent]:
            self.ended[agent] = "terminated" if env.terminations[agent] else "truncated"
        self.infos[agent], self.seen[agent] = env.infos[agent], turn

    def outcome(
        self, seed: int | None, env: Any, turns: int, *, is_over: bool, error: str | None
    ) -> Outcome:
        """Outcome; where the episode was cut, with rewards that agents had not been shown yet."""
        waiting = getattr(env, "_cumulative_rewards", {})
        for agent in env.agents:
            if agent != env.agent_selection:
                self.returns[agent] = self.returns.get(agent, 0.0) + waiting.get(agent, 0.0)
        return super().outcome(seed, env, turns, is_over=is_over, error=error)
