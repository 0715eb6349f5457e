"""A vector environment as Gymnasium's: every agent of every copy is one of its environments."""

from operator import itemgetter
from typing import Any, Final

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as GymnasiumVectorEnv
from gymnasium.vector.utils import batch_space

from gamekeeper.errors import SpecError, check_choice
from gamekeeper.vector.final_rows import AgentInfos, FinalObs
from gamekeeper.vector.vector_form import ALL, changed

ABSENT: Final = ("refuse", "zeros")


class AgentsAsEnvs(GymnasiumVectorEnv[Any, Any, Any]):
    """Sub-environment e * A + a is agent a of copy e.

    Kept: seeds, both autoreset modes, terminations and truncations of each agent, its final
    observation, masks. Lost: nothing; who acts with whom is no business of Gymnasium's. Refused: an
    agent that isn't in the game while its copy plays (it has ended, or joins later). Gymnasium's
    environments begin anew as they end, and this one can't before its copy does, so that whoever
    doesn't know would count and learn steps in between that were none. `absent="zeros"` shows
    zeros and reward 0 in them, and `infos["live"]` is False there.
    """

    def __init__(self, venv: Any, *, absent: str = "refuse") -> None:
        """Takes over a vector environment.

        Args:
            venv: a vector environment.
            absent: `refuse` or `zeros`: how an agent is shown that isn't in the game.
        Raises:
            SpecError: its agents differ in their spaces, or act in turn; or there is no such way.
        """
        what = "there is no such way to show who isn't in the game"
        check_choice(absent, ABSENT, what, where="absent")
        groups = venv.groups
        if len(groups) != 1 or groups[0].name != ALL or venv.api != "parallel":
            raise SpecError(
                "not every agent is a sub-environment of one kind",
                where="as_gymnasium",
                expected="a Parallel environment whose agents share their spaces",
                actual=f"{venv.api}, roles {[group.name for group in groups]}",
                fix="step the vector environment itself, or its roles one by one",
            )
        self.venv, self._refuses = venv, absent == "refuse"
        self.count = len(groups[0].agents)
        self.num_envs = venv.num_envs * self.count
        self.single_observation_space = groups[0].observation_space
        self.single_action_space = groups[0].action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        mode = AutoresetMode.SAME_STEP if venv.autoreset == "same_step" else AutoresetMode.NEXT_STEP
        self.metadata = {**venv.metadata, "autoreset_mode": mode}

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begins the run of this seed.

        Raises:
            SpecError: there are many seeds; or an agent isn't in the game, and that is refused.
        """
        if isinstance(seed, list):
            raise SpecError(
                "the seed isn't one whole number",
                where="seed",
                expected="a whole number or None",
                actual=repr(seed)[:80],
                fix="give one whole number; each sub-environment gets seeds of its own from it",
            )
        obs, infos = self.venv.reset(seed=seed, options=options)
        nobody = np.zeros(self.num_envs, bool)
        return changed(obs, self._by_agent), self._infos(infos, nobody, nobody)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step of every agent of every copy.

        Raises:
            SpecError: an agent isn't in the game any more, and that is refused.
        """
        shaped = changed(actions, lambda a: np.asarray(a).reshape(-1, self.count, *a.shape[1:]))
        obs, *parts, infos = self.venv.step(shaped)
        rewards, terminated, truncated = [part.reshape(-1) for part in parts]
        own = self._infos(infos, terminated, truncated)
        return changed(obs, self._by_agent), rewards, terminated, truncated, own

    def close(self, **kwargs: Any) -> None:
        """Closes every copy."""
        self.venv.close()
        self.closed = True

    def _by_agent(self, array: Any) -> Any:
        return array.reshape(self.num_envs, *array.shape[2:])

    def _infos(self, infos: dict[str, Any], terminated: Any, truncated: Any) -> dict[str, Any]:
        if self._refuses:
            self._check(infos["live"])
        found: dict[str, Any] = {
            key: self._by_agent(infos[key]) for key in ("live", "action_mask") if key in infos
        }
        if "final_obs" not in infos:
            return found
        ended = terminated | truncated
        finals, final_infos, places = infos["final_obs"], infos["final_info"], np.flatnonzero(ended)
        at = finals.rows[places // self.count], places % self.count
        found["final_obs"] = FinalObs(self.num_envs, places, changed(finals.tree, itemgetter(at)))
        agents = self.venv.groups[0].agents
        found["final_info"] = AgentInfos(self.num_envs, places, final_infos, agents)
        found["_final_obs"] = found["_final_info"] = ended
        return found

    def _check(self, live: Any) -> None:
        """Refuses copies that play without some of their agents."""
        if np.count_nonzero(live) == live.size:
            return
        plays_on = live.any(1) & ~live.all(1)
        if plays_on.any():
            e = int(plays_on.argmax())
            a = int(live[e].argmin())
            raise SpecError(
                "an agent isn't in the game while its copy plays on, which no environment of "
                "Gymnasium's can be",
                where=f"copy {e}, agent {self.venv.groups[0].agents[a]!r}",
                expected="agents that begin and end together",
                actual=f"{int(live[e].sum())} of {self.count} agents in the game",
                fix="absent='zeros', and leave out the steps in which infos['live'] was False "
                "before; or an adapter that knows of agents, as gamekeeper.adapters.sb3",
            )
