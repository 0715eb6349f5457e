"""The vector environment: what users step, the same for every engine."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.episodes.layout import Layout
from gamekeeper.errors import ActionError, OrderError
from gamekeeper.vector.final_rows import FinalInfos, FinalObs
from gamekeeper.vector.sub_env_block import Autoreset, StepOutputs
from gamekeeper.vector.vector_form import ALL, Arrays, VectorForm, VectorGroup, built
from gamekeeper.vector.vector_rows import Batches, InOrder, Recording


class Engine(Protocol):
    """Engine that steps the sub-environments."""

    @property
    def arrays(self) -> Arrays:
        """Arrays of all sub-environments; read after a step, written (actions) before one."""

    @property
    def failed(self) -> Mapping[int, str]:
        """Copies that nobody steps any more, and why."""

    def reset(self, seed: int, options: Any) -> StepOutputs:
        """Begins a run."""

    def record(self, recording: Recording, out: Callable[[Batches], None]) -> None:
        """Every copy's rows go to `out` from its next episode on."""

    def end_recording(self) -> None:
        """Ends the episodes in progress; the rest of the rows goes out."""

    def step(self) -> StepOutputs:
        """One step of every copy."""

    def close(self) -> None:
        """Closes every copy."""


@dataclass(frozen=True, slots=True)
class SourceEnv:
    """Facts of the environment that is copied, for evidence to name it."""

    spec: str
    metadata: Mapping[str, Any]
    identity: Mapping[str, Any]
    contract: Contract | None
    layout: Layout


class VectorEnv:
    """Copies of one environment, stepped together.

    Arrays are [env, agent, ...], of AEC environments what the agent in turn is given is [env, ...].
    Where agents differ in their spaces, a dictionary of such arrays by role stands in their place.
    Slots of dead agents hold zeros, and `infos["live"]` is False there.

    Attributes:
        api: `aec` or `parallel`.
        agents: names of the agents, column by column; by role where their spaces differ.
        autoreset: `same_step`: a copy whose agents have all ended begins its next episode in the
            step that ended it. `next_step`: it does so in the step after, whose actions are passed
            over for that copy. Last observations stand in `infos["final_obs"]`.
        copies: arrays are handed out as copies; else the next step overwrites them.
        observation_space: of all copies together.
        action_space: likewise.
        fix_of_masked: advice to a learner that did what a mask forbids.
    """

    fix_of_masked = "choose by infos['action_mask']: plain DQN and PPO read no masks"

    def __init__(
        self,
        engine: Engine,
        form: VectorForm,
        *,
        num_envs: int,
        seed: int,
        autoreset: Autoreset,
        copy: bool = True,
        seen: SourceEnv,
    ) -> None:
        """Use `gk.vector.make`."""
        self.num_envs, self.api, self.autoreset = num_envs, form.api, autoreset
        self.spec, self.metadata, self.seen = seen.spec, dict(seen.metadata), seen
        self._engine, self._form, self._seed, self.copies = engine, form, seed, copy
        self._is_begun = self._is_closed = False
        self._in_order: InOrder | None = None
        self._on_close: Callable[[], None] = lambda: None
        named = {group.name: list(group.agents) for group in form.groups}
        self.agents: Any = named.pop(ALL) if ALL in named else named
        self.observation_space = batched(form.groups, "observation_space", form.api, num_envs)
        self.action_space = batched(form.groups, "action_space", form.api, num_envs)

    @property
    def groups(self) -> tuple[VectorGroup, ...]:
        """Agents that share their spaces, with their columns."""
        return self._form.groups

    @property
    def unwrapped(self) -> Self:
        """Itself."""
        return self

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins a run: slot i plays the episodes i, i + num_envs, ... of run `seed`.

        Args:
            seed: of the run; None: the one that the vector environment was made with.
        Returns:
            Observations and infos.
        Raises:
            OrderError: it is closed, or recorded and was reset before.
        """
        self._check(begun=False)
        if self._is_begun and self._in_order is not None:
            raise OrderError(
                "recorded sub-environments were reset a second time",
                fix="close the vector environment, and make another one for another run",
            )
        outputs = self._engine.reset(self._seed if seed is None else int(seed), options)
        self._is_begun = True
        return self._obs("obs"), self._infos(outputs)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of every copy.

        Args:
            actions: [env, agent, ...] (of AEC environments [env, ...], for the agents in turn), or
                such arrays by role. Those of dead agents are passed over.
        Returns:
            Observations, rewards [env, agent], terminations, truncations, infos. In `infos`: `live`
            [env, agent]; `episode` [env], the number of the episode that each copy is in;
            `over` [env], whether its episode ended in this step; `action_mask`; `turn` (AEC)
            [env], the column of the agent in turn; `final_obs` and `final_info`, [env] objects
            that are made as they are read, with `_final_obs` [env] bool, where agents ended: what
            all were given in that step (of AEC environments, what those that have ended were given
            last);
            `failed`, texts by env, where the process of some is gone.
        Raises:
            ActionError: the arrays haven't the right shape; or an environment raised, or its rules
                refuse, after an agent did what its mask forbids.
            EnvError: another environment raised, or its process died or hung; says which.
        """
        self._check(begun=True)
        self._take(actions)
        try:
            outputs = self._engine.step()
        except ActionError as error:
            if not any(group.flags for group in self.groups):
                raise
            raise ActionError(**error.parts() | {"fix": self.fix_of_masked}) from error
        arrays = self._engine.arrays
        flags = [self._by_group(arrays[name]) for name in ("rewards", "terminated", "truncated")]
        return self._obs("obs"), *flags, self._infos(outputs)

    def close(self) -> None:
        """Closes every copy; once is enough."""
        if self._is_closed:
            return
        self._is_closed = True
        try:
            if self._in_order is not None:
                self._engine.end_recording()
                self._in_order.finish()
        finally:
            self._engine.close()
            self._on_close()

    def as_gymnasium(self, *, absent: str = "refuse") -> Any:
        """A `gymnasium.vector.VectorEnv`, of which every agent of every copy is an environment.

        Args:
            absent: an agent that isn't in the game while its copy plays is refused (`refuse`), or
                shown zeros and reward 0 (`zeros`), with `infos["live"]` False.
        Raises:
            SpecError: agents differ in their spaces, or act in turn.
        """
        from gamekeeper.vector.agents_as_envs import AgentsAsEnvs

        return AgentsAsEnvs(self, absent=absent)

    def record(
        self,
        write: Callable[[str, Any], None],
        *,
        level: str,
        terms: tuple[str, ...],
        volatile: tuple[str, ...],
        on_close: Callable[[], None],
    ) -> None:
        """Records every copy from the next reset on; `gk.record` is what users call.

        Args:
            write: takes a stream's name and a batch of rows, episode after episode in their order.
            level: `full` or `digest`.
            terms: reward terms by name.
            volatile: info fields that stay out of the info fingerprint.
            on_close: called once all is written and every copy is closed.
        Raises:
            OrderError: it was reset already, is recorded already, or is closed.
        """
        self._check(begun=False)
        if self._is_begun or self._in_order is not None:
            raise OrderError(
                "recording begins before the first reset", fix="record right after making it"
            )
        self._in_order = InOrder(write)
        self._on_close = on_close
        self._engine.record(Recording(level, terms, volatile), self._in_order.take)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, traceback: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<VectorEnv of {self.num_envs} x {self.spec}>"

    # -- actions

    def _take(self, actions: Any) -> None:
        for g, group in enumerate(self._form.groups):
            given = actions if group.name == ALL else self._of_role(actions, group.name)
            for i, leaf in enumerate(group.acted):
                array = self._engine.arrays[f"action.{g}.{i}"]
                try:
                    value = given
                    for key in leaf.path:
                        value = value[key]
                    found = np.asarray(value)
                    if found.shape != array.shape:
                        raise ValueError(f"shape {found.shape}")
                    np.copyto(array, found, casting="same_kind")
                except (TypeError, ValueError, KeyError, IndexError) as error:
                    raise ActionError(
                        "the actions don't fit",
                        where=group.name or "actions",
                        expected=f"an array of shape {array.shape}, {array.dtype}",
                        actual=said_by(error),
                        fix="see venv.action_space",
                    ) from None

    def _of_role(self, actions: Any, name: str) -> Any:
        if not isinstance(actions, Mapping) or name not in actions:
            raise ActionError(
                "the actions don't name every role",
                where="actions",
                expected=f"a dictionary with {[group.name for group in self._form.groups]}",
                actual=str(list(actions) if isinstance(actions, Mapping) else type(actions)),
                fix="hand in a dictionary with an array of actions for each role",
            )
        return actions[name]

    # -- what comes back

    def _own(self, array: Any) -> Any:
        return array.copy() if self.copies else array

    def _by_group(self, array: Any) -> Any:
        groups = self._form.groups
        if groups[0].name == ALL:
            return self._own(array)
        return {group.name: self._own(array[:, group.columns]) for group in groups}

    def _obs(self, kind: str, envs: NDArray[np.intp] | None = None) -> Any:
        """Observations of all sub-environments, or in arrays of their own those of some."""
        parts = {}
        for g, group in enumerate(self._form.groups):
            whole = (self._engine.arrays[f"{kind}.{g}.{i}"] for i in range(len(group.observed)))
            arrays = (self._own(array) if envs is None else array[envs] for array in whole)
            parts[group.name] = built(group.observation_space, arrays)
        return parts.get(ALL, parts)

    def _infos(self, outputs: StepOutputs) -> dict[str, Any]:
        arrays, groups = self._engine.arrays, self._form.groups
        infos: dict[str, Any] = {
            "live": self._by_group(arrays["live"]),
            "episode": self._own(arrays["episode"]),
            "over": self._own(arrays["ended"]),
        }
        masks = {
            group.name: self._own(arrays[f"mask.{g}"])
            for g, group in enumerate(groups)
            if group.flags
        }
        if masks:
            infos["action_mask"] = masks.get(ALL, masks)
        if self.api == "aec":
            infos["turn"] = self._own(arrays["turn"])
        if outputs.infos:
            infos["agents"] = _objects(self.num_envs, outputs.infos)
        final = outputs.read_final or outputs.final
        if final:
            final_infos = FinalInfos(self.num_envs, final)
            is_final = np.zeros(self.num_envs, bool)
            is_final[final_infos.envs] = True
            infos["final_obs"] = FinalObs(
                self.num_envs, final_infos.envs, self._obs("final", final_infos.envs)
            )
            infos["final_info"] = final_infos
            infos["_final_obs"] = infos["_final_info"] = is_final
        if self._engine.failed:
            infos["failed"] = dict(self._engine.failed)
        return infos

    # -- the rest

    def _check(self, *, begun: bool) -> None:
        if self._is_closed:
            raise OrderError("the vector environment is closed", fix="make another one")
        if begun and not self._is_begun:
            raise OrderError("step came before reset", fix="call reset(seed=...) first")


def batched(groups: Sequence[VectorGroup], kind: str, api: str, num_envs: int) -> spaces.Space[Any]:
    """The space of all sub-environments together; `kind`: `observation_space`, `action_space`."""

    def whole(group: VectorGroup) -> spaces.Space[Any]:
        one = getattr(group, kind)
        inner = one if api == "aec" else batch_space(one, len(group.agents))
        return batch_space(inner, num_envs)

    if groups[0].name == ALL:
        return whole(groups[0])
    return spaces.Dict({group.name: whole(group) for group in groups})


def _objects(count: int, found: Mapping[int, Any]) -> Any:
    """[env] objects; None where there is none."""
    objects = np.empty(count, object)
    for e, value in found.items():
        objects[e] = value
    return objects
