"""Copies that stand still at their end until they are told to begin anew, as TorchRL's do.

A vector environment resets by itself. TorchRL shows an end first and resets copies later, some of
them, also in mid-episode, and without stepping the others. So this reaches into the engines of
`gamekeeper.vector`, in this one file; what crosses processes can't be reached, and resets itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.core.contract import Contract
from gamekeeper.core.seeds import episode_seed
from gamekeeper.errors import EnvError, SpecError
from gamekeeper.vector.block import Said, bare
from gamekeeper.vector.form import Group
from gamekeeper.vector.front import make

Bools = NDArray[np.bool_]


class Copies:
    """Copies of an environment, their arrays at hand.

    Args:
        spec, num_envs, seed, engine: as `gk.vector.make` has them, and so the other options.

    Attributes:
        venv: the vector environment.
        over: [copy], whose episode ended in the last step, and who hasn't begun anew since.
        run_seed: of the run that they play.
        is_begun: whether they were reset.
        told: infos by agent of each copy, where they were asked for.
    """

    def __init__(
        self, spec: object, num_envs: int, *, seed: int, engine: str, **options: Any
    ) -> None:
        self._stands_still = engine != "process"
        self.venv = make(
            spec, num_envs, seed=seed, engine=engine, copy=False,
            autoreset="next_step" if self._stands_still else "same_step", **options,
        )  # fmt: skip
        self._engine: Any = self.venv._engine
        self._is_kernel = engine == "kernel"
        self.num_envs, self.api = num_envs, self.venv.api
        self.groups: tuple[Group, ...] = self.venv.groups
        self.agents: list[Any] = [agent for group in self.groups for agent in group.agents]
        self.contract = self.venv.seen.contract or Contract()
        self.over: Bools = np.zeros(num_envs, bool)
        self.told: dict[int, Mapping[Any, Any]] = {}
        self.run_seed, self._seed, self._runs, self.is_begun = seed, seed, 0, False

    @property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Of all copies, by the names of `Form.plan`; the next step overwrites them."""
        arrays: Mapping[str, NDArray[Any]] = self._engine.arrays
        return arrays

    def begin(self, seed: int) -> None:
        """Every copy begins its first episode of the run `seed`."""
        self._seed, self._runs = seed, 0
        self._begin(seed)

    def _begin(self, seed: int) -> None:
        self.run_seed, self.is_begun = seed, True
        _, infos = self.venv.reset(seed=seed)
        self.over[...] = False
        self._hear(infos)

    def step(self, actions: Any) -> None:
        """One step of every copy; `over` says whose episode ended in it."""
        _, _, _, _, infos = self.venv.step(actions)
        self.over[...] = infos.get("_final_obs", False)
        self._hear(infos)

    def restart(self, which: Bools) -> None:
        """These copies begin their next episodes; nobody else is stepped.

        Raises:
            SpecError: some are in the midst of an episode, and in another process.
        """
        if self._stands_still:
            said = self._next_of_kernel(which) if self._is_kernel else self._next_of_block(which)
            self.told.update(said.infos)
        elif (which & ~self.over).any():
            if not which.all():
                raise SpecError(
                    "copies in other processes can't be reset one by one in mid-episode",
                    where="_reset",
                    expected="copies whose episode is over, or all of them",
                    seen=f"copies {np.flatnonzero(which & ~self.over).tolist()}",
                    mend="engine='serial' or 'kernel', or let the environment truncate by itself",
                )
            self._runs += 1
            self._begin(episode_seed(self._seed, self._runs))
        self.over &= ~which

    def _next_of_kernel(self, which: Bools) -> Said:
        if self._engine._scribe is not None:
            raise SpecError(
                "what begins anew here isn't written down", where="gk.record(env.venv)",
                mend="gk.rollout(spec, policies=torchrl.policy(actor, env), out=...)",
            )  # fmt: skip
        batch = self._engine._batch
        over = batch.arrays.over
        kept = over & ~which
        over[...] = which
        batch.restart()
        over[...] = kept
        said: Said = self._engine._said(is_reset=True)
        return said

    def _next_of_block(self, which: Bools) -> Said:
        block, said = self._engine._block, Said()
        try:
            for e in np.flatnonzero(which).tolist():
                self.arrays["over"][e] = False
                block._episodes[e] += block._slots
                block._begin(e, said)
            block._pour()
        except Exception as error:
            raise self._engine._named(error) from error
        return said

    def state_space(self, *, is_asked: bool | None) -> spaces.Space[Any] | None:
        """The space of `state()`, [...] of one copy; None where it isn't shown.

        Args:
            is_asked: True: also where none is declared, as it is then. None: only where one is.
        Raises:
            SpecError: it is asked for, and there is none.
        """
        if is_asked is False or (is_asked is None and not self._stands_still):
            return None
        if not self._stands_still:
            raise SpecError(
                "state() doesn't cross processes", where="state", seen="engine='process'",
                mend="engine='serial' or 'kernel', or state=False",
            )  # fmt: skip
        if self._is_kernel:
            declared = self._engine._kernel.state_space
        else:
            env = bare(self._engine._block.doors[0])
            declared = getattr(env, "state_space", getattr(env.unwrapped, "state_space", None))
        if isinstance(declared, spaces.Space) or not is_asked:
            return declared if isinstance(declared, spaces.Box) else None
        self.begin(self.run_seed)  # so that every copy has a state
        seen = self.state()[0]
        return spaces.Box(-np.inf, np.inf, seen.shape, seen.dtype.type)

    def state(self) -> NDArray[Any]:
        """What `state()` gives in every copy, [copy, ...]: of who is over, that of the end.

        Raises:
            SpecError: there is none.
            EnvError: an environment raised.
        """
        if self._is_kernel:
            if self._engine._kernel.overview is None:
                raise SpecError("the kernel has no state()", where="state", mend="state=False")
            states: NDArray[Any] = self._engine._batch.overview().copy()
            return states
        try:
            return np.stack([np.asarray(bare(door).state()) for door in self._engine._block.doors])
        except (NotImplementedError, AttributeError) as error:
            raise SpecError(
                "the environment has no state()", where="state", seen=repr(error),
                mend="state=False",
            ) from error  # fmt: skip
        except Exception as error:
            raise EnvError(
                f"state() raised {type(error).__name__}: {error}", where="state", mend="state=False"
            ) from error

    def close(self) -> None:
        """Closes every copy."""
        self.venv.close()

    def _hear(self, infos: Mapping[str, Any]) -> None:
        if "agents" in infos:
            self.told = {e: told for e, told in enumerate(infos["agents"]) if told is not None}
