"""A block of Parallel copies: each step is one tick of every copy.

What a tick gives is collected in lists and poured into the arrays once, when every copy has had its
tick: a row of an array costs more to write alone than all of them together.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import chain
from operator import itemgetter
from typing import Any, TypeAlias

import numpy as np

from gamekeeper.interface.capture import AgentId
from gamekeeper.vector.sub_env_block import StepOutputs, SubEnvBlock, bare, put_mask
from gamekeeper.vector.vector_form import ArrayLeaf, built, getter

Row: TypeAlias = tuple[Any, ...]
"""One value for each agent, in the order of the columns."""


class TickBlock(SubEnvBlock):
    """Copies of a Parallel environment."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._bare = [bare(env) for env in self.envs]
        self._pick = _picker(self._agents)
        groups = self.form.groups
        self._blanks = {agent: _blank(group) for group in groups for agent in group.agents}
        self._masked = [agent for group in groups if group.flags for agent in group.agents]
        nothing = tuple(self._blanks.values())
        self._seen: list[Row] = [nothing] * len(self.envs)
        self._legal: list[Row] = [(None,) * len(self._masked)] * len(self.envs)
        self._is_whole = [False] * len(self.envs)

    def step(self) -> StepOutputs:
        """One tick of every copy; a copy that is over begins anew, when `autoreset` says so."""
        outputs, arrays, count = StepOutputs(), self._arrays, self._count
        paid: list[float] = []
        actions = self._tables()
        fresh = arrays["over"].tolist()
        for name in ("terminated", "truncated", "ended"):
            arrays[name][...] = False
        cursor, agents, pick = arrays["cursor"], self._agents, self._pick
        for e, env in enumerate(self._bare):
            cursor[0] = e
            if fresh[e]:  # next_step: this step resets, and no action is taken
                paid += [0.0] * count
                self._begin_next(e, outputs)
                continue
            live = env.agents
            if len(live) == count:
                acted = dict(zip(agents, actions[e], strict=True))
            else:
                acted = {agent: actions[e][self._column[agent]] for agent in live}
            out = self.envs[e].step(acted)
            try:
                paid += pick(out[1])
            except KeyError:  # not everybody is there
                paid += [out[1].get(agent, 0.0) for agent in agents]
            self._take(e, acted, env.agents, out, outputs)
            self._after_env()
        self._pour()
        arrays["rewards"].reshape(-1)[:] = paid
        return outputs

    def _begin(self, e: int, outputs: StepOutputs) -> None:
        observations, infos = self._reset_env(e)
        self._show(e, observations, infos, self._bare[e].agents)
        if self._wants_infos:
            outputs.infos[e] = infos

    def _begin_next(self, e: int, outputs: StepOutputs) -> None:
        self._arrays["over"][e] = False
        self._episodes[e] += self._slots
        self._begin(e, outputs)

    def _take(
        self,
        e: int,
        acted: Collection[AgentId],
        live: Sequence[AgentId],
        out: Any,
        outputs: StepOutputs,
    ) -> None:
        """Keeps what a tick gave; `out` is what the environment returned."""
        observations, _, terms, truncs, infos = out
        if len(acted) != self._count or len(live) != self._count:
            terms = self._with_departures(acted, live, terms, truncs)
        has_ended = True in terms.values() or True in truncs.values()
        if has_ended:
            self._note_ends(e, terms, truncs)
        if self._wants_infos:
            outputs.infos[e] = infos
        is_over = not live or (has_ended and all(terms.get(a) or truncs.get(a) for a in live))
        if has_ended or is_over:
            outputs.final[e] = dict(infos)
            self._keep_final(e, observations)
        if not is_over:
            self._show(e, observations, infos, live)
            return
        self._arrays["ended"][e] = True
        if self.autoreset == "same_step":
            self._begin_next(e, outputs)
        else:
            self._arrays["over"][e] = True
            self._show(e, observations, infos, ())

    def _with_departures(
        self, acted: Collection[AgentId], live: Sequence[AgentId], terms: Any, truncs: Any
    ) -> Any:
        """Returns terminations, with those of agents that left without an ending."""
        here = set(live)
        left = [a for a in acted if a not in here and not (terms.get(a) or truncs.get(a))]
        return {**terms, **dict.fromkeys(left, True)} if left else terms

    def _note_ends(self, e: int, terms: Any, truncs: Any) -> None:
        column = self._column
        for name, flags in (("terminated", terms), ("truncated", truncs)):
            row = self._arrays[name][e]
            for agent, flag in flags.items():
                if flag:
                    row[column[agent]] = True

    def _keep_final(self, e: int, observations: Any) -> None:
        """Keeps last observations of agents that end in a step; zeros for the others."""
        row = [observations.get(agent, self._blanks[agent]) for agent in self._agents]
        for g, group in enumerate(self.form.groups):
            for i, leaf in enumerate(group.observed):
                get = getter(leaf.path)
                final = self._arrays[f"final.{g}.{i}"]
                for a, observation in enumerate(row[group.columns]):
                    final[e, a] = get(observation)

    def _show(self, e: int, observations: Any, infos: Any, live: Sequence[AgentId]) -> None:
        """Writes observations, live flags and masks of the sub-environment's agents."""
        is_whole, row = len(live) == self._count, self._arrays["live"][e]
        if not (is_whole or self._is_whole[e]):  # what agents are shown that ended before is zeros
            observations = {
                a: observations[a]
                for a, was_live in zip(self._agents, row.tolist(), strict=True)
                if (was_live or a in live) and a in observations
            }
        try:
            self._seen[e] = self._pick(observations)
        except KeyError:
            blanks = self._blanks
            self._seen[e] = tuple([observations.get(a, blanks[a]) for a in self._agents])
        if not (is_whole and self._is_whole[e]):
            row[...] = False
            for agent in live:
                row[self._column[agent]] = True
            self._is_whole[e] = is_whole
        if self._masked:
            find = self.form.masks
            self._legal[e] = tuple(find[a](observations.get(a), infos.get(a)) for a in self._masked)

    def _pour(self) -> None:
        for g, group in enumerate(self.form.groups):
            rows = (
                self._seen
                if len(group.agents) == self._count
                else ([row[group.columns] for row in self._seen])
            )
            for i, leaf in enumerate(group.observed):
                self._pour_leaf(self._arrays[f"obs.{g}.{i}"], leaf, rows)
        self._pour_masks()

    def _pour_leaf(self, array: Any, leaf: ArrayLeaf, rows: list[Row]) -> None:
        """Writes one array of observations, [env, agent, ...]."""
        values = list(chain.from_iterable(rows))
        if leaf.path:
            get = getter(leaf.path)
            values = [get(value) for value in values]
        try:
            if not leaf.shape:
                array.reshape(-1)[:] = values
                return
            if _are_of_shape(values, leaf.shape):
                whole = array.reshape(-1, *leaf.shape[1:])
                np.concatenate(values, out=whole, casting="same_kind")
                return
        except (TypeError, ValueError):  # one by one, as NumPy's assignment takes it
            pass
        agents, cursor = array.shape[1], self._arrays["cursor"]
        for place, value in enumerate(values):
            e, a = divmod(place, agents)
            cursor[0] = e  # so that whose observation can't be stored is named
            array[e, a] = value

    def _pour_masks(self) -> None:
        first = 0
        for g, group in enumerate(self.form.groups):
            if not group.flags:
                continue
            array, cursor = self._arrays[f"mask.{g}"], self._arrays["cursor"]
            mine = slice(first, first + len(group.agents))
            first += len(group.agents)
            values = list(chain.from_iterable(row[mine] for row in self._legal))
            if _are_of_shape(values, (group.flags,)):
                np.concatenate(values, out=array.reshape(-1), casting="unsafe")
            else:
                for place, value in enumerate(values):
                    e, a = divmod(place, len(group.agents))
                    cursor[0] = e
                    put_mask(array[e, a], value)
            array[~self._arrays["live"][:, group.columns]] = 0

    def _tables(self) -> list[Any]:
        """The actions of each copy, agent by agent, as the spaces have them."""
        parts = [read() for read in self._actions]
        if len(parts) == 1:
            return parts[0]
        return [[action for part in row for action in part] for row in zip(*parts, strict=True)]


def _picker(agents: Sequence[AgentId]) -> Callable[[Mapping[AgentId, Any]], Row]:
    """Function that takes all agents' values out of a dictionary, in the order of columns."""
    if len(agents) > 1:
        return itemgetter(*agents)
    only = agents[0]
    return lambda values: (values[only],)


def _blank(group: Any) -> Any:
    """Placeholder for the observation of an agent that isn't live."""
    zeros: Iterator[Any] = (np.zeros(leaf.shape, leaf.dtype) for leaf in group.observed)
    return built(group.observation_space, zeros)


def _are_of_shape(values: list[Any], shape: tuple[int, ...]) -> bool:
    """Tells whether all are arrays of this shape, so that none can take another one's place."""
    try:
        return {value.shape for value in values} == {shape}
    except AttributeError:
        return False
