"""From one agent after the other to all at once: AEC environments behind the Parallel API."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from gymnasium.spaces import Space
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from gamekeeper.core.contract import Contract
from gamekeeper.errors import ActionError, ContractError, SpecError
from gamekeeper.game.accounts import books_of, paid_others, pays_others
from gamekeeper.game.books import Books
from gamekeeper.game.legality import judge, learn_ranges, refused
from gamekeeper.game.to_aec import ToAEC
from gamekeeper.game.verbs import AgentId, before_reset

DECLARED: Final = "as declared"
FEW: Final = 4  # agents: up to here adding every reward takes less than finding those that count
STYLES: Final = ("cycle", "turn")

Told = tuple[Any, Any, Any, Any]  # observation, terminated, truncated, info
Step = tuple[
    dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, dict[str, Any]]
]


def to_parallel(
    env: Any, *, order: str | None = None, style: str = "cycle"
) -> ParallelEnv[Any, Any, Any]:
    """The same game, all agents at once.

    A Parallel environment is handed back as it is, and one that `to_aec` converted is unpacked;
    anything else becomes a `ToParallel`, whose docstring says what is kept, changed and lost.

    Args:
        env: an AECEnv; it now belongs to the converted environment.
        order: "as declared" where the environment doesn't say that a round of its turns can be one
            tick: all choose by what they see as the tick begins, and their actions are played in
            the environment's own order.
        style: "cycle": a tick is a round of turns; "turn": a tick is one turn, and only the action
            of the agent in turn counts.
    Raises:
        SpecError: a round of its turns isn't declared to be one tick; or it is no environment.
    """
    _check_options(order, style)
    if isinstance(env, ParallelEnv):
        return env
    if style == "cycle":
        if type(env) is ToAEC:
            return env.env
        if type(env) is OrderEnforcingWrapper and type(env.env) is parallel_to_aec_wrapper:
            return env.env.env
    if not isinstance(env, AECEnv):
        raise SpecError(
            "only a PettingZoo environment can be converted",
            where="to_parallel",
            expected="an AECEnv",
            seen=f"{type(env).__module__}.{type(env).__qualname__}",
            mend="open it first: to_parallel(gamekeeper.make(spec))",
        )
    if style == "cycle" and order is None and not is_parallelizable(env):
        raise _unlike_ticks(env)
    return ToParallel(env, style=style)


def is_parallelizable(env: AECEnv[Any, Any, Any]) -> bool:
    """Whether an AEC environment declares that nothing changes within a round of its turns.

    It says so in `metadata["is_parallelizable"]`, or its contract does: observations show what was
    after the tick.
    """
    if (getattr(env, "metadata", None) or {}).get("is_parallelizable", False):
        return True
    form = getattr(env.unwrapped, "declared", None)
    return isinstance(form, Contract) and form.schedule.observe == "after tick"


class ToParallel(ParallelEnv[Any, Any, Any]):
    """An AEC environment as a Parallel environment: a round of turns is one tick.

    The law of `style="cycle"`. A tick has one turn of each agent that was live as it began, in the
    environment's own order, whichever that is in this round. An agent's reward is the sum of what
    all turns of the tick paid it. An agent that ended before its turn has no turn, and its action
    is not played. Who ended gets its last observation, flags and info as its None turn shows them,
    in the step in which it ended. The others are shown what is there as the next round begins.
    For an environment whose state, rewards and endings change with the last turn of a round only,
    this is what `last()` gives everybody. Where they change earlier, agents choose by what was
    there as the tick began, and that is why it takes `order="as declared"`.

    The law of `style="turn"`. A tick is one turn: the action of the agent in turn is played, those
    of the others aren't looked at and may be absent; everybody is shown what is there after it.

    | | |
    |---|---|
    | kept | agents, late joiners, spaces, seeds and options; all rewards, so every return; endings with the last observation and info of the dying; masks; `state()`, `state_space`, rendering, render mode; reward terms where the environment tells them |
    | changed | infos are copies, as they are then: the next turn writes into the originals |
    | checked | every live agent has an action, nobody else has; each is in its space (masks are left to the environment's rules), before the first one is played |
    | lost | what agents see between the turns of one tick. Refused is a round in which an agent would have two turns, or a joiner one, before all others had theirs, and a reward that is paid after an end was told |
    """  # noqa: E501  # rows of a table

    agents: list[Any]
    terms: dict[Any, dict[str, float]]

    def __init__(self, env: AECEnv[Any, Any, Any], *, style: str = "cycle") -> None:
        """Takes hold of an environment; nothing is called on it yet."""
        super().__init__()
        self.env = env
        self.style = style
        self.metadata = getattr(env, "metadata", {})
        self.render_mode = getattr(env, "render_mode", None)
        if hasattr(env, "possible_agents"):
            self.possible_agents = env.possible_agents
        if hasattr(env, "state_space"):
            self.state_space = env.state_space
        self._books: Any = books_of(env)
        self._keeps_books = isinstance(self._books, Books)
        self._has_terms = isinstance(getattr(self._books, "terms", None), dict)
        if self._has_terms:
            self.terms = {}
        self._spaces: dict[Any, Space[Any]] = {}
        self._ranges: dict[Any, range] = {}
        self._gone: dict[Any, Told] = {}  # who had its None turn in this tick
        self._lingering: set[Any] = set()  # whose end was told and who hasn't had its None turn

    # -- what goes to the environment itself

    @property
    def unwrapped(self) -> Any:
        """The environment under all conversions and wrappers."""
        return self.env.unwrapped

    def observation_space(self, agent: AgentId) -> Space[Any]:
        """The environment's own observation space of an agent."""
        return self.env.observation_space(agent)  # type: ignore[no-any-return]

    def action_space(self, agent: AgentId) -> Space[Any]:
        """The environment's own action space of an agent."""
        return self.env.action_space(agent)  # type: ignore[no-any-return]

    @property
    def observation_spaces(self) -> dict[Any, Space[Any]]:
        """The observation spaces of all possible agents."""
        return {agent: self.observation_space(agent) for agent in self.possible_agents}

    @property
    def action_spaces(self) -> dict[Any, Space[Any]]:
        """The action spaces of all possible agents."""
        return {agent: self.action_space(agent) for agent in self.possible_agents}

    @property
    def to_move(self) -> list[Any]:
        """Whose actions the next step plays."""
        if self.style == "turn":
            return [self._books.agent_selection] if self.agents else []
        return list(self.agents)

    def state(self) -> Any:
        """The environment's own state."""
        return self.env.state()

    def render(self) -> Any:
        """The environment's own picture."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def __str__(self) -> str:
        return str(self.env)

    # -- PettingZoo's side

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[Any, Any], dict[Any, dict[str, Any]]]:
        """Begins an episode, with the same seed and options: observations, infos."""
        given = {"seed": seed, "options": options}
        self.env.reset(**{name: value for name, value in given.items() if value is not None})
        self._gone, self._lingering = {}, set()
        self._bury_the_dying()
        self._gone = {}
        agents = self.agents = self._live()
        self._learn(agents)
        return self._observations(agents), self._infos(agents)

    def step(self, actions: Mapping[Any, Any]) -> Step:
        """Plays one tick: observations, rewards, terminations, truncations, infos.

        Actions that are refused leave everything as it was. Once everybody has ended nothing is
        played any more: five empty dictionaries.

        Raises:
            OrderError: there was no reset.
            ActionError: an agent has no action, one that isn't live has one, or one isn't in its
                space.
            ContractError: a round of turns isn't a tick.
        """
        if not hasattr(self, "agents"):
            raise before_reset("step")
        if not self.agents:
            return {}, {}, {}, {}, {}
        self._check(actions)
        if self._gone:
            self._gone = {}
        if self._has_terms:
            self.terms = {}
        totals = self._turn(actions) if self.style == "turn" else self._round(actions)
        books, agents = self._books, self.agents
        terms, truncs, rewards = books.terminations, books.truncations, books.rewards
        if (
            self._gone
            or books.agents != agents
            or any(terms.values())
            or any(truncs.values())
            or not len(agents) == len(terms) == len(truncs) == len(rewards)
        ):
            return self._told(totals)
        if totals is None:
            totals = dict(rewards)
        return self._observations(agents), totals, dict(terms), dict(truncs), self._infos(agents)

    def _turn(self, actions: Mapping[Any, Any]) -> dict[Any, Any] | None:
        """One turn of one agent; what was paid in it, None where nobody was."""
        agent = self._books.agent_selection
        self.env.step(actions[agent])
        return self._added(None, agent)

    def _round(self, actions: Mapping[Any, Any]) -> dict[Any, Any] | None:
        """One turn of everybody; what was paid in them, None where nobody was."""
        books, step, added = self._books, self.env.step, self._added
        left = set(self.agents)
        totals: dict[Any, Any] | None = None
        while left:
            agent = books.agent_selection
            if agent not in left:
                if self._stops(agent, left):
                    break
            elif books.terminations[agent] or books.truncations[agent]:
                left.remove(agent)
                self._bury(agent)
            else:
                left.remove(agent)
                step(actions[agent])
                totals = added(totals, agent)
        return totals

    def _stops(self, agent: AgentId, left: set[Any]) -> bool:
        """Whether a round is over although some had no turn: they left without an ending.

        Raises:
            ContractError: they are there, and somebody else has a turn.
        """
        books = self._books
        if not books.agents:
            return True
        if books.terminations[agent] or books.truncations[agent]:
            self._bury(agent)
            return False
        left.intersection_update(books.agents)
        if left:
            raise _no_round(agent, left, self.agents)
        return True

    # -- rewards

    def _added(self, totals: dict[Any, Any] | None, actor: AgentId) -> dict[Any, Any] | None:
        """Totals of a tick with what the last turn paid."""
        books = self._books
        rewards = books.rewards
        if self._has_terms and books.terms:
            self._add_terms(books.terms)
        paid: Iterable[Any]
        if self._keeps_books:
            paid = books.touched.paid
            if not paid:
                return totals
        elif totals is None or len(rewards) <= FEW:
            paid = rewards
        else:
            paid = _paid(rewards, actor)
        if totals is None:
            return dict(rewards)
        for agent in paid:
            totals[agent] = totals[agent] + rewards[agent] if agent in totals else rewards[agent]
        return totals

    def _add_terms(self, paid: Mapping[Any, Mapping[str, float]]) -> None:
        for agent, amounts in paid.items():
            sums = self.terms.setdefault(agent, {})
            for term, amount in amounts.items():
                sums[term] = sums.get(term, 0.0) + amount

    # -- who is told what as a tick ends

    def _told(self, totals: dict[Any, Any] | None) -> Step:
        """The five dictionaries of a tick whose turns have been played."""
        self._bury_the_dying()
        books, gone = self._books, self._gone
        agents = self.agents = self._live()
        self._learn(agents)
        observations, infos = self._observations(agents), self._infos(agents)
        terms, truncs = books.terminations, books.truncations
        terminations = {agent: terms[agent] for agent in agents}
        truncations = {agent: truncs[agent] for agent in agents}
        for agent, (observation, terminated, truncated, info) in gone.items():
            observations[agent], infos[agent] = observation, info
            terminations[agent], truncations[agent] = terminated, truncated
        if totals is None:
            rewards = {
                agent: 0.0 if agent in gone else books.rewards.get(agent, 0.0)
                for agent in observations
            }
        else:
            if totals.keys() - observations.keys():
                self._check_paid(totals, observations)
            rewards = {agent: totals.get(agent, 0.0) for agent in observations}
        return observations, rewards, terminations, truncations, infos

    def _live(self) -> list[Any]:
        """Who can act next; who has ended and waits for its None turn is told now."""
        books = self._books
        terms, truncs = books.terminations, books.truncations
        agents = list(books.agents)
        if not any(terms.values()) and not any(truncs.values()):
            self._lingering.clear()
            return agents
        dying = [agent for agent in agents if terms[agent] or truncs[agent]]
        for agent in dying:
            if agent not in self._lingering:
                self._gone[agent] = self._last_words(agent)
        self._lingering = set(dying)
        return [agent for agent in agents if agent not in self._lingering]

    def _bury_the_dying(self) -> None:
        """None turns of those who ended, as far as the environment asks for them now."""
        books = self._books
        while books.agents:
            agent = books.agent_selection
            if not (books.terminations[agent] or books.truncations[agent]):
                return
            self._bury(agent)

    def _bury(self, agent: AgentId) -> None:
        """An agent's None turn; what it is given in it is what it is told last."""
        books = self._books
        if agent not in self._lingering and agent not in self._gone:
            self._gone[agent] = self._last_words(agent)
        self.env.step(None)
        if agent in books.agents and books.agent_selection == agent:
            raise ContractError(
                f"agent {agent!r} ended and doesn't leave",
                where="step(None)",
                expected="an agent that is out of the roster after its None turn",
                seen="one that is in turn again",
                mend="call self._was_dead_step(action) where the agent in turn has ended",
            )

    def _last_words(self, agent: AgentId) -> Told:
        """What an agent that ended is given."""
        books = self._books
        return (
            self._observations((agent,))[agent],
            books.terminations[agent],
            books.truncations[agent],
            self._infos((agent,))[agent],
        )

    def _observations(self, agents: Iterable[Any]) -> dict[Any, Any]:
        view = self._books._view if self._keeps_books else self._books.observe
        return {agent: view(agent) for agent in agents}

    def _infos(self, agents: Iterable[Any]) -> dict[Any, dict[str, Any]]:
        """New infos; those of our own base class are asked for, as it tells them one by one."""
        books = self._books
        if getattr(books, "_masks", False) or getattr(books, "_informs", False):
            return {agent: books._info_of(agent) for agent in agents}
        infos = books.infos
        try:
            return {agent: infos[agent].copy() for agent in agents}
        except (AttributeError, KeyError):  # no dictionary, which is told as it is; or none at all
            return {agent: _copied(infos.get(agent, {})) for agent in agents}

    # -- actions

    def _learn(self, agents: list[Any]) -> None:
        """Reads the action spaces of agents that are new."""
        ranges = self._ranges
        if ranges.keys() >= set(agents):
            return
        trusted = getattr(self._books, "_trusts_ranges", True)
        learn_ranges(agents, self.env.action_space, self._spaces, ranges, trusted=trusted)

    def _check(self, actions: Mapping[Any, Any]) -> None:
        """Looks at all actions before one of them is played.

        Raises:
            ActionError: one is missing, too many, or outside its space.
        """
        if not isinstance(actions, Mapping):
            raise _mismatch(actions, self.agents)
        agents = self.agents
        if self.style == "turn":
            agents = [self._books.agent_selection]
            if not set(actions) <= set(self.agents):
                raise _mismatch(actions, self.agents)
        elif len(actions) != len(agents):
            raise _mismatch(actions, agents)
        ranges = self._ranges
        for agent in agents:
            if agent not in actions:
                raise _mismatch(actions, agents)
            action = actions[agent]
            if type(action) is not int or action not in ranges[agent]:
                self._check_one(agent, action)

    def _check_one(self, agent: AgentId, action: Any) -> None:
        books = self._books
        if self._keeps_books:
            if not getattr(books, "_pardons", False):
                books._judge(agent, action)
            return
        space = self._spaces[agent]
        if not judge(space, action)[0]:
            raise refused(agent, action, space)

    def _check_paid(self, totals: Mapping[Any, Any], told: Mapping[Any, Any]) -> None:
        """Whoever was paid is told so, or it is an error."""
        for agent, reward in totals.items():
            if agent in self._lingering and agent not in told:
                raise ContractError(
                    f"agent {agent!r} was paid after it had ended",
                    where="step, rewards",
                    expected="0, until its None turn",
                    seen=repr(reward)[:300],
                    mend="pay what is owed in the turn that ends it",
                )


def _paid(rewards: Mapping[Any, Any], actor: AgentId) -> Iterable[Any]:
    """Whom `rewards` pays; the actor may stand there with 0."""
    own = rewards.get(actor)
    if pays_others(rewards, own):
        others = paid_others(rewards, actor)
        return [*others, actor] if actor in rewards else others
    return (actor,) if own else ()


def _copied(info: Any) -> Any:
    return dict(info) if info.__class__ is dict else info


def _check_options(order: str | None, style: str) -> None:
    if order not in (None, DECLARED) or style not in STYLES:
        raise SpecError(
            "there is no such conversion",
            where="to_parallel",
            expected=f"order=None or {DECLARED!r}, style={' or '.join(map(repr, STYLES))}",
            seen=f"order={order!r}, style={style!r}",
        )


def _unlike_ticks(env: AECEnv[Any, Any, Any]) -> SpecError:
    metadata = getattr(env, "metadata", None) or {}
    return SpecError(
        f"{metadata.get('name', type(env).__name__)} can't be opened as parallel",
        where="to_parallel",
        expected="metadata['is_parallelizable'] = True: a round of turns is one tick",
        seen=f"metadata['is_parallelizable'] = {metadata.get('is_parallelizable')!r}",
        mend="open it as aec; set the key where its agents do act all at once; or convert it "
        f"with order={DECLARED!r}, where all may choose before the first acts, or style='turn'",
    )


def _no_round(agent: AgentId, left: set[Any], agents: list[Any]) -> ContractError:
    again = agent in agents
    return ContractError(
        "a round of turns isn't a tick",
        where="agent_selection",
        expected=f"a turn of one of {sorted(map(repr, left))}"[:300],
        seen=f"another turn of {agent!r}" if again else f"a turn of {agent!r}, who has just joined",
        mend="convert it with style='turn'",
    )


def _mismatch(actions: Any, agents: list[Any]) -> ActionError:
    """Which agents have no action, and which shouldn't have one."""
    if not isinstance(actions, Mapping):
        seen = f"{actions!r} ({type(actions).__name__})"
    else:
        missing = [repr(agent) for agent in agents if agent not in actions]
        extra = [repr(agent) for agent in actions if agent not in agents]
        faults = (("no action of", missing), ("an action of", extra))
        seen = "; ".join(f"{fault} {', '.join(names)}" for fault, names in faults if names)
    return ActionError(
        "the actions of a tick aren't those of the live agents",
        where="step",
        expected=f"one of each of {agents!r}"[:300],
        seen=seen[:600],
        mend="build the dictionary over env.agents",
    )
