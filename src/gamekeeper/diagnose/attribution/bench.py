"""The work bench: a set-up opened once, in which coalitions are played and papers played again."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, TypeVar

from gamekeeper.core.canon import from_json, to_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.core.seeds import episode_seed
from gamekeeper.core.trace import Trace
from gamekeeper.diagnose.attribution.film import Film, Paper, Swap
from gamekeeper.diagnose.attribution.sides import Sides
from gamekeeper.diagnose.setup import Setup
from gamekeeper.errors import EnvError
from gamekeeper.game.door import AgentId
from gamekeeper.game.faces import game_of
from gamekeeper.game.open import open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.run.change import Hooks
from gamekeeper.run.episode import Course, Play
from gamekeeper.run.play import Cast
from gamekeeper.run.rerun import play_of

Baseline: TypeAlias = Literal["noop", "random", "reference"]
SomeFilm = TypeVar("SomeFilm", bound=Film)


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be attributed, as plain data.

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
        """Whether policies are known, so that agents can react."""
        return bool(self.setup.policies)

    def to_json(self) -> dict[str, Any]:
        """Plain data for a worker process."""
        return {
            "setup": self.setup.to_json(), "contract": self.contract.to_json(),
            "players": list(self.players), "others": list(self.others),
            "baseline": dict(self.baseline), "seed": self.seed, "run_seed": self.run_seed,
        }  # fmt: skip

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Task:
        """What `to_json` gave."""
        return cls(
            setup=Setup.from_json(data["setup"]), contract=Contract.from_json(data["contract"]),
            players=tuple(data["players"]), others=tuple(data["others"]),
            baseline=data["baseline"], seed=data["seed"], run_seed=data["run_seed"],
        )  # fmt: skip


class Bench:
    """An environment and its two casts. Use as a context: it closes the environment."""

    def __init__(self, task: Task, *, on_step: Callable[[], None] | None = None) -> None:
        """Opens the environment and finds the policies.

        Raises:
            SpecError: the environment can't be opened.
            PolicyError: a policy can't be found.
        """
        self.task, self.contract = task, task.contract
        self._on_step = on_step or _nothing
        self.env: Any = open_env(task.setup.spec, **task.setup.kwargs).env
        try:
            self.own: Any = None
            if task.is_closed:
                self.own = cast_of(dict(task.setup.policies), self.env, self.contract)
                self.baseline: Any = cast_of(self._baseline(), self.env, self.contract)
        except BaseException:
            self.env.close()
            raise

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *exception: object) -> None:
        self.env.close()

    def role_of(self, agent: AgentId) -> str | None:
        """An agent's role, declared or by its name."""
        return self.contract.role_of(agent) or role_in_name(agent_name(agent))

    # -- plays

    def closed(self, number: int, members: Collection[str]) -> Film:
        """A fresh episode in which `members` play their policies and the others the baseline."""
        task = self.task
        cast: Cast = self.own
        if len(members) < len(task.players):
            cast = Sides(
                self.own, self.baseline, members, task.players, task.others, self.role_of, self.env
            )  # fmt: skip
        film = Film(self.env, self.contract, cast=cast, counts=True)
        return self._filmed(film, self._play(number))

    def fresh(self, number: int) -> Paper:
        """What everybody does in a fresh episode."""
        play = self._play(number)
        film = self._filmed(Film(self.env, self.contract, cast=self.own), play)
        turns = len(film.rewards)
        return Paper(play.seed, play.options, turns, film.actions, number, "fresh")

    def from_paper(
        self,
        paper: Paper,
        swap: Swap | None = None,
        *,
        turns: int | None = None,
        rng: Any = None,
        sees: bool = False,
    ) -> Film:
        """A paper played again, with one agent doing otherwise.

        Args:
            turns: it is cut there; otherwise where the paper ends.
            rng: draws other actions.
            sees: also keep what was given.
        """
        film = Film(self.env, self.contract, paper=paper, swap=swap, rng=rng, sees=sees)
        return self.watched(film, paper, turns=turns)

    def watched(self, film: SomeFilm, paper: Paper, *, turns: int | None = None) -> SomeFilm:
        """A paper played again, for a film that knows what it looks for."""
        most = paper.turns if turns is None else min(turns, paper.turns)
        play = Play(
            seed=paper.seed, stream=paper.number, most_turns=max(most, 1), options=paper.options,
            looks_last=False,
        )  # fmt: skip
        return self._filmed(film, play)

    def reacting(self, film: SomeFilm, number: int, *, turns: int | None = None) -> SomeFilm:
        """A fresh episode in which policies choose, for a film that knows what it looks for."""
        play = self._play(number)
        most = play.most_turns if turns is None else min(turns, play.most_turns)
        return self._filmed(film, replace(play, most_turns=most))

    def paper_of(self, trace: Trace) -> Paper:
        """What was done in a recorded episode."""
        play = play_of(trace, self.env)
        actions: dict[str, list[Any]] = {}
        for turn in play.actions or ():
            for agent, action in turn.items():
                if action is not None:
                    actions.setdefault(agent_name(agent), []).append(action)
        return Paper(play.seed, play.options, len(play.actions or ()), actions, trace.episode)

    def _filmed(self, film: SomeFilm, play: Play) -> SomeFilm:
        course = Course(
            play, game_of(self.env), film, Hooks(), film, self._on_step, self.contract
        )  # fmt: skip
        film.begin(self.task.run_seed, play.stream)
        failed = course.run()
        if failed is not None:
            raise EnvError(
                "a play broke off",
                where=f"seed {play.seed}, turn {failed.turn}, {failed.call}",
                seen=f"{failed.kind}: {failed.text}",
            )
        return film

    def _play(self, number: int) -> Play:
        setup = self.task.setup
        return Play(
            seed=episode_seed(self.task.run_seed, number),
            stream=number,
            most_turns=setup.most_turns,
            options=setup.options[number % len(setup.options)],
            looks_last=False,
        )

    def _baseline(self) -> dict[str, str]:
        """Baselines of the players; for those who join late that of their role's first."""
        found = dict(self.task.baseline)
        for agent in getattr(self.env, "possible_agents", ()):
            role = self.role_of(agent)
            peers = [name for name in self.task.players if self.role_of(name) == role]
            if agent_name(agent) not in found:
                found[agent_name(agent)] = found[peers[0]] if peers else "random"
        return found


def paper_to_json(paper: Paper) -> dict[str, Any]:
    """A paper as plain data, its actions in their very types."""
    given = [paper.seed, paper.options, paper.turns, {a: list(x) for a, x in paper.actions.items()}]
    return {"given": to_json(given), "number": paper.number, "run": paper.run}


def paper_from_json(data: Mapping[str, Any]) -> Paper:
    """What `paper_to_json` gave."""
    given: Any = from_json(data["given"])
    seed, options, turns, actions = given
    return Paper(seed, options, turns, actions, data["number"], data["run"])


def _nothing() -> None:
    """Nobody counts."""
