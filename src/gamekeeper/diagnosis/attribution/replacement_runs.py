"""Reruns in which agents are replaced, for some of them or for single actions."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import Any, Literal, TypeAlias, TypeVar

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.attribution.recorded_actions import ActionTrack, EpisodeActions, Swap
from gamekeeper.diagnosis.open_setup import OpenSetup, Setup
from gamekeeper.diagnosis.plain_data import frozen
from gamekeeper.episodes.canonical import from_json, to_json
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.episodes.plain_json import plain
from gamekeeper.errors import EnvError, PolicyError
from gamekeeper.interface.capture import AgentId
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.rollouts.episode_loop import ActionChooser, EpisodeLoop, EpisodePlan
from gamekeeper.rollouts.intervention import Hooks
from gamekeeper.rollouts.reruns import play_of
from gamekeeper.runs.recording import joint_policy_of


class Sides:
    """A joint policy of two: members of a coalition play their own, others the baseline.

    `others` are no players though they are there from the start: they play their policies.

    One who joins late is on the side of the one of its role who left last; where nobody of its role
    has left, on the side of most of them, that of the policies where they are equal.
    """

    def __init__(self, runner: ReplacementRunner, members: Collection[str]) -> None:
        self._own: ActionChooser = runner.joint_policy
        self._baseline: ActionChooser = runner.baseline
        self._start = {player: player in members for player in runner.task.players}
        self._start |= dict.fromkeys(runner.task.others, True)
        self._role_of, self._env = runner.role_of, runner.env
        self._side: dict[str, bool] = {}
        self._last: dict[str, int] = {}
        self._decisions = 0

    def begin(self, run_seed: int, episode: int) -> None:
        """Seeds all policies for an episode; nobody has joined yet."""
        self._own.begin(run_seed, episode)
        self._baseline.begin(run_seed, episode)
        self._side, self._last, self._decisions = dict(self._start), {}, 0

    def act(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """Action of an agent on its side."""
        name = agent_name(agent)
        side = self._side.get(name)
        if side is None:
            side = self._side[name] = self._joined(agent)
        self._decisions += 1
        self._last[name] = self._decisions
        return (self._own if side else self._baseline).act(agent, observation, info)

    def _joined(self, agent: AgentId) -> bool:
        role, live = self._role_of(agent), {agent_name(each) for each in self._env.agents}
        peers = [name for name in self._side if self._role_of(name) == role]
        gone = [name for name in peers if name not in live and name in self._last]
        if gone:
            return self._side[max(gone, key=self._last.__getitem__)]
        own = sum(self._side[name] for name in peers)
        return 2 * own >= len(peers)


Baseline: TypeAlias = Literal["noop", "random", "reference"]
SomeTrack = TypeVar("SomeTrack", bound=ActionTrack)


@dataclass(frozen=True, slots=True)
class ReplacementTask:
    """Attribution to be made, as plain data.

    Attributes:
        setup: as it was recorded; without policies nobody can choose anew.
        contract: names terms, noops, masks, messages.
        players: those whose part is asked for.
        others: agents that are there from the start and no players.
        baseline: by player, what takes the place of its policy.
        seed: all draws come from it.
        run_seed: of fresh episodes.
    """

    setup: Setup
    contract: Contract
    players: tuple[str, ...]
    others: tuple[str, ...]
    baseline: Mapping[str, str]
    seed: int
    run_seed: int

    @property
    def is_closed(self) -> bool:
        """True where policies are known, so that agents can react."""
        return bool(self.setup.policies)

    def to_json(self) -> dict[str, Any]:
        """Plain data for a worker process."""
        return {name: plain(getattr(self, name)) for name in self.__slots__}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ReplacementTask:
        """Inverse of `to_json`."""
        setup, contract = Setup.from_json(data["setup"]), Contract.from_json(data["contract"])
        return cls(**frozen({**data, "setup": setup, "contract": contract}))


class ReplacementRunner(OpenSetup):
    """An open set-up with a second joint policy, the baseline; without policies it has none."""

    def __init__(self, task: ReplacementTask, *, on_step: Callable[[], None] | None = None) -> None:
        """Opens the environment and finds the policies.

        Raises:
            SpecError: the environment can't be opened.
            PolicyError: a policy can't be found.
        """
        super().__init__(task.setup, task.contract)
        self.task, self._on_step, self.steps = task, on_step, 0
        try:
            self.baseline: Any = self._open_baseline() if task.is_closed else None
        except BaseException:
            self.close()
            raise

    @property
    def identity(self) -> dict[str, Any]:
        """Identity of the attribution: source, arguments, policies, baselines, contract."""
        task = self.task
        contract = json.dumps(task.contract.to_json(), sort_keys=True)
        return {
            **super().identity,
            "seed": [task.seed, task.run_seed],
            "baseline": dict(task.baseline),
            "contract": blake2b(contract.encode(), digest_size=16).hexdigest(),
        }

    def role_of(self, agent: AgentId) -> str | None:
        """An agent's role, declared or by its name."""
        return self.contract.role_of(agent) or role_in_name(agent_name(agent))

    # -- plays

    def closed(self, number: int, members: Collection[str]) -> ActionTrack:
        """A fresh episode in which `members` play their policies and the others the baseline."""
        is_whole = len(members) == len(self.task.players)
        joint_policy = self.joint_policy if is_whole else Sides(self, members)
        track = ActionTrack(self.env, self.contract, joint_policy=joint_policy, counts=True)
        return self._tracked(track, self._fresh(number))

    def fresh(self, number: int) -> EpisodeActions:
        """Actions of all agents in a fresh episode."""
        play = self._fresh(number)
        track = ActionTrack(self.env, self.contract, joint_policy=self.joint_policy)
        turns = len(self._tracked(track, play).rewards)
        return EpisodeActions(play.seed, play.options, turns, track.actions, number, "fresh")

    def from_script(
        self,
        script: EpisodeActions,
        swap: Swap | None = None,
        *,
        turns: int | None = None,
        rng: Any = None,
        sees: bool = False,
    ) -> ActionTrack:
        """A script played again, with one agent doing otherwise.

        Args:
            turns: it is cut there; otherwise where the script ends.
            rng: draws other actions.
            sees: also keep what was given.
        """
        track = ActionTrack(self.env, self.contract, script=script, swap=swap, rng=rng, sees=sees)
        return self.watched(track, script, turns=turns)

    def watched(
        self, track: SomeTrack, script: EpisodeActions, *, turns: int | None = None
    ) -> SomeTrack:
        """A script played again, for a track that knows what it looks for."""
        most = script.turns if turns is None else min(turns, script.turns)
        play = EpisodePlan(
            seed=script.seed,
            stream=script.number,
            most_turns=max(most, 1),
            options=script.options,
            asks_last=False,
        )
        return self._tracked(track, play)

    def reacting(self, track: SomeTrack, number: int, *, turns: int | None = None) -> SomeTrack:
        """A fresh episode in which policies choose, for a track that knows what it looks for."""
        play = self._fresh(number)
        most = play.most_turns if turns is None else min(turns, play.most_turns)
        return self._tracked(track, replace(play, most_turns=most))

    def script_of(self, episode: Episode) -> EpisodeActions:
        """Actions of a recorded episode."""
        play = play_of(episode, self.env)
        actions: dict[str, list[Any]] = {}
        for turn in play.actions or ():
            for agent, action in turn.items():
                if action is not None:
                    actions.setdefault(agent_name(agent), []).append(action)
        return EpisodeActions(
            play.seed, play.options, len(play.actions or ()), actions, episode.episode
        )

    def _tracked(self, track: SomeTrack, play: EpisodePlan) -> SomeTrack:
        loop = EpisodeLoop(
            play, capture_of(self.env), track, Hooks(), track, self._count, self.contract
        )
        track.begin(self.task.run_seed, play.stream)
        failed = loop.run()
        if failed is not None:
            raise EnvError(
                "an episode broke off",
                where=f"seed {play.seed}, turn {failed.turn}, {failed.call}",
                actual=failed.said,
                fix="replay the episode with this seed; the environment raised there",
            )
        return track

    def _count(self) -> None:
        self.steps += 1
        if self._on_step is not None:
            self._on_step()

    def _fresh(self, number: int) -> EpisodePlan:
        return replace(self.plan(self.task.run_seed, number), asks_last=False)

    def _open_baseline(self) -> Any:
        """The policies that take agents' places; of those who join late that of their role's first.

        Raises:
            PolicyError: the environment has no such policy.
        """
        found = dict(self.task.baseline)
        for agent in getattr(self.env, "possible_agents", ()):
            peers = [x for x in self.task.players if self.role_of(x) == self.role_of(agent)]
            found.setdefault(agent_name(agent), found[peers[0]] if peers else "random")
        try:
            return joint_policy_of(found, self.env, self.contract)
        except PolicyError as error:
            raise PolicyError(
                error.what,
                where="baseline",
                expected="noop or random; reference where the environment brings one",
                actual=error.actual,
                fix="take --baseline noop or --baseline random",
            ) from error


def script_to_json(script: EpisodeActions) -> str:
    """A script as text, its actions in their very types."""
    actions = {agent: list(mine) for agent, mine in script.actions.items()}
    return to_json([script.seed, script.options, script.turns, actions, script.number, script.run])


def script_from_json(text: str) -> EpisodeActions:
    """Inverse of `script_to_json`."""
    given: Any = from_json(text)
    return EpisodeActions(*given)
