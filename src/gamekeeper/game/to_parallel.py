"""From one agent after the other to all at once: AEC environments behind the Parallel API."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from gamekeeper.core.contract import Contract
from gamekeeper.errors import ContractError, SpecError
from gamekeeper.game.authoring.verbs import AgentId, before_reset
from gamekeeper.game.converting.around import Around
from gamekeeper.game.converting.tick import Step, Tick
from gamekeeper.game.converting.tick_rewards import Totals
from gamekeeper.game.to_aec import ToAEC

DECLARED: Final = "as declared"
STYLES: Final = ("cycle", "turn")


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


class ToParallel(Around, Tick, ParallelEnv[Any, Any, Any]):
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

    terms: dict[Any, dict[str, float]]

    def __init__(self, env: AECEnv[Any, Any, Any], *, style: str = "cycle") -> None:
        """Takes hold of an environment; nothing is called on it yet."""
        super().__init__(env)
        self.style = style
        self.metadata = getattr(env, "metadata", {})
        self.render_mode = getattr(env, "render_mode", None)
        self._list_agents()
        if hasattr(env, "state_space"):
            self.state_space = env.state_space
        if self._rewards.has_terms:
            self.terms = {}

    @property
    def to_move(self) -> list[Any]:
        """Whose actions the next step plays."""
        if self.style == "turn":
            return [self._books.agent_selection] if self.agents else []
        return list(self.agents)

    # -- PettingZoo's side

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[Any, Any], dict[Any, dict[str, Any]]]:
        """Begins an episode, with the same seed and options: observations, infos."""
        given = {"seed": seed, "options": options}
        self.env.reset(**{name: value for name, value in given.items() if value is not None})
        self._list_agents()
        self._gone, self._lingering = {}, set()
        self._bury_the_dying()
        self._gone = {}
        agents = self.agents = self._live()
        self._actions.learn(agents)
        return self._observations(agents), self._infos(agents)

    def _list_agents(self) -> None:
        """Notes the possible agents, which some environments know only once they were reset."""
        if hasattr(self.env, "possible_agents"):
            self.possible_agents = self.env.possible_agents

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
        if self._rewards.has_terms:
            self.terms = self._rewards.terms = {}
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

    def _turn(self, actions: Mapping[Any, Any]) -> Totals | None:
        """One turn of one agent; what was paid in it, None where nobody was."""
        agent = self._books.agent_selection
        self.env.step(actions[agent])
        return self._rewards.added(None, agent)

    def _round(self, actions: Mapping[Any, Any]) -> Totals | None:
        """One turn of everybody; what was paid in them, None where nobody was."""
        books, step, added = self._books, self.env.step, self._rewards.added
        totals: Totals | None = None
        for place, agent in enumerate(self.agents):
            if (
                books.agent_selection != agent
                or books.terminations[agent]
                or books.truncations[agent]
            ):
                return self._rest_of_round(actions, totals, set(self.agents[place:]))
            step(actions[agent])
            totals = added(totals, agent)
        return totals

    def _rest_of_round(
        self, actions: Mapping[Any, Any], totals: Totals | None, left: set[Any]
    ) -> Totals | None:
        """The turns that are left, where the order isn't the roster's or somebody has ended."""
        books, step, added = self._books, self.env.step, self._rewards.added
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

    def _check(self, actions: Mapping[Any, Any]) -> None:
        """Looks at all actions before one of them is played."""
        if self.style == "turn":
            self._actions.check_turn(actions, self.agents, self._books.agent_selection)
        else:
            self._actions.check(actions, self.agents)


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
