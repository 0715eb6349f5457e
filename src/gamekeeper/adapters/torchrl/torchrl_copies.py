"""Copies of an environment that stay at their end until they are reset, as TorchRL's do.

A vector environment resets by itself. TorchRL shows an end first and resets copies later, some of
them, also in mid-episode, and without stepping the others. So this reaches into the engines of
`gamekeeper.vector`, in this one file. A copy in another process can't be reached: it resets itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.errors import EnvError, SpecError
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.vector.sub_env_block import StepOutputs, bare
from gamekeeper.vector.vector_factory import make
from gamekeeper.vector.vector_form import VectorGroup

if TYPE_CHECKING:
    from gamekeeper.vector.kernel_engine import KernelEngine
    from gamekeeper.vector.serial_engine import SerialEngine

Bools = NDArray[np.bool_]
FIX_OF_MASKED: Final = (
    "ProbabilisticActor(in_keys={'logits': ..., 'mask': (group, 'action_mask')},"
    " distribution_class=MaskedCategorical), with env(..., masks=True)"
)


class Copies:
    """Copies of an environment, their arrays at hand.

    Args:
        spec, num_envs, seed, engine: as `gk.vector.make` has them, and so the other options.

    Attributes:
        venv: the vector environment.
        over: [copy], copies whose episode ended in the last step and that weren't reset since.
        run_seed: of the run that they play.
        is_begun: True once they were reset.
        obs, infos: as the vector environment returned them, over its own arrays; in
            `infos["agents"]` infos by agent of each copy, where they were asked for.
    """

    def __init__(
        self, spec: object, num_envs: int, *, seed: int, engine: str = "serial", **options: Any
    ) -> None:
        self._stands_still = engine != "process"
        self.venv = make(
            spec,
            num_envs,
            seed=seed,
            engine=engine,
            copy=False,
            autoreset="next_step" if self._stands_still else "same_step",
            **options,
        )
        self.venv.fix_of_masked = FIX_OF_MASKED
        self._engine: Any = self.venv._engine
        self._is_kernel = engine == "kernel"
        self.num_envs, self.api = num_envs, self.venv.api
        self.groups: tuple[VectorGroup, ...] = self.venv.groups
        self.agents: list[Any] = [agent for group in self.groups for agent in group.agents]
        self.contract = self.venv.seen.contract or Contract()
        self.over: Bools = np.zeros(num_envs, bool)
        self.obs: Any = None
        self.infos: dict[str, Any] = {}
        self.run_seed, self._seed, self._runs, self.is_begun = seed, seed, 0, False

    @property
    def _of_kernel(self) -> KernelEngine:
        return cast("KernelEngine", self._engine)  # with its type, so that names are checked

    @property
    def _serial(self) -> SerialEngine:
        return cast("SerialEngine", self._engine)

    @property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Arrays of all copies, by the names of `Form.plan`; the next step overwrites them."""
        return cast("Mapping[str, NDArray[Any]]", self._engine.arrays)

    def begin(self, seed: int) -> None:
        """Begins the first episode of the run `seed` in every copy."""
        self._seed, self._runs = seed, 0
        self._begin(seed)

    def _begin(self, seed: int) -> None:
        self.run_seed, self.is_begun = seed, True
        self.obs, self.infos = self.venv.reset(seed=seed)
        self.over[...] = False

    def step(self, actions: Any) -> None:
        """Steps every copy; `over` tells which episodes ended in it."""
        self.obs, *_, self.infos = self.venv.step(actions)
        self.over[...] = self.infos["over"]

    def restart(self, which: Bools) -> None:
        """Begins the next episodes of these copies; the others aren't stepped.

        Raises:
            SpecError: some are in the midst of an episode, and in another process.
        """
        if self._stands_still:
            outputs = self._next_of_kernel(which) if self._is_kernel else self._next_of_block(which)
            for copy, infos in outputs.infos.items():
                self.infos.setdefault("agents", {})[copy] = infos
        elif (which & ~self.over).any():
            if not which.all():
                raise SpecError(
                    "copies in other processes can't be reset one by one in mid-episode",
                    where="_reset",
                    expected="copies whose episode is over, or all of them",
                    actual=f"copies {np.flatnonzero(which & ~self.over).tolist()}",
                    fix="engine='serial' or 'kernel', or let the environment truncate by itself",
                )
            self._runs += 1
            self._begin(episode_seed(self._seed, self._runs))
        self.over &= ~which

    def _next_of_kernel(self, which: Bools) -> StepOutputs:
        if self._of_kernel._recorder is not None:
            raise SpecError(
                "copies that are reset one by one can't be recorded",
                where="gk.record(env.venv)",
                fix="record: gk.rollout(spec, policies=torchrl.policy(actor, env), out=...)",
            )
        batch = self._of_kernel._batch
        over = batch.arrays.over
        kept = over & ~which
        over[...] = which
        batch.restart()
        over[...] = kept
        return self._of_kernel._outputs(is_reset=True)

    def _next_of_block(self, which: Bools) -> StepOutputs:
        block, outputs = self._serial._block, StepOutputs()
        try:
            for e in np.flatnonzero(which).tolist():
                self.arrays["over"][e] = False
                block._episodes[e] += block._slots
                block._begin(e, outputs)
            block._pour()
        except Exception as error:
            raise self._serial._named(error) from error
        return outputs

    def state_space(self, *, is_asked: bool | None) -> spaces.Space[Any] | None:
        """Returns the space of `state()`, [...] of one copy; None where it isn't shown.

        Args:
            is_asked: True: also where none is declared, as it is then. None: only where one is.
        Raises:
            SpecError: it is asked for, and there is none.
        """
        if is_asked is False or (is_asked is None and not self._stands_still):
            return None
        if not self._stands_still:
            raise SpecError(
                "state() doesn't cross processes",
                where="state",
                actual="engine='process'",
                fix="engine='serial' or 'kernel', or state=False",
            )
        if self._is_kernel:
            declared: Any = self._of_kernel._kernel.state_space
        else:
            env = bare(self._serial._block.envs[0])
            declared = getattr(env, "state_space", getattr(env.unwrapped, "state_space", None))
        if isinstance(declared, spaces.Space) or not is_asked:
            return declared if isinstance(declared, spaces.Box) else None
        self.begin(self.run_seed)  # so that every copy has a state
        seen = self.state()[0]
        return spaces.Box(-np.inf, np.inf, seen.shape, seen.dtype.type)

    def state(self) -> NDArray[Any]:
        """Returns `state()` of every copy, [copy, ...]; where an episode is over, that of its end.

        Raises:
            SpecError: there is none.
            EnvError: an environment raised.
        """
        if self._is_kernel:
            if self._of_kernel._kernel.overview is None:
                raise SpecError("the kernel has no state()", where="state", fix="state=False")
            return np.array(self._of_kernel._batch.overview())
        try:
            return np.stack([np.asarray(bare(env).state()) for env in self._serial._block.envs])
        except (NotImplementedError, AttributeError) as error:
            raise SpecError(
                "the environment has no state()",
                where="state",
                actual=repr(error),
                fix="state=False",
            ) from error
        except Exception as error:
            raise EnvError(
                f"state() raised {type(error).__name__}: {error}", where="state", fix="state=False"
            ) from error

    def close(self) -> None:
        """Closes every copy."""
        self.venv.close()
