"""Checks of observations beside their spaces."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.space_facts import AskedSpace, OthersView
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import MASK, Episode, Turn
from gamekeeper.episodes.spaces.misfit import (
    BOUNDS,
    DTYPE,
    NAN,
    SHAPE,
    STRUCTURE,
    Misfit,
    misfits,
    suspects,
)

MASK_PATH: Final = f"[{MASK!r}]"
"""End of the path of a part that is an action mask."""


@dataclass(slots=True)
class _Rows:
    """Observations of one agent in one episode."""

    turns: list[Turn] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)


def spaces_of(evidence: ProbeEvidence, which: str) -> dict[str, Any]:
    """The space of each agent, `observation` or `action`; also those known only after a reset."""
    found = {
        name: getattr(spec, f"{which}_space")
        for name, spec in evidence.agents.items()
        if getattr(spec, f"{which}_space") is not None
    }
    for fact in evidence.facts(AskedSpace):
        if fact.value.which == which and fact.value.space is not None:
            found.setdefault(str(fact.where.agent), fact.value.space)
    return found


def misfit_cases(evidence: ProbeEvidence, kind: str) -> Cases:
    """Yields a case for every observation that was given: whether it misses its space in `kind`."""
    known, actions = spaces_of(evidence, "observation"), spaces_of(evidence, "action")
    for episode in (*evidence["rollout"], *evidence["spaces"]):
        exact, nonconforming = _rows(episode, known)
        for agent, rows in exact.items():
            is_open = kind in (BOUNDS, NAN) and rows.values
            bad = suspects(known[agent], rows.values, kind) if is_open else frozenset()
            for at, turn in enumerate(rows.turns):
                if at in bad:
                    yield _looked(
                        evidence, episode, turn, agent, known[agent], rows.values[at], kind
                    )
                else:
                    yield Case(episode.at(turn, agent, "observations"), True)
        for agent, rows in nonconforming.items():
            if kind in (DTYPE, SHAPE) and _is_of_another_kind(known[agent], rows):
                continue  # GK211 tells it: once an array, where a number is declared
            with_masks = not _is_told(agent, known[agent], actions.get(agent), rows, kind)
            for turn, value in zip(rows.turns, rows.values, strict=True):
                yield _looked(evidence, episode, turn, agent, known[agent], value, kind, with_masks)


def _rows(episode: Episode, known: Mapping[str, Any]) -> tuple[dict[str, _Rows], dict[str, _Rows]]:
    """Rows whose structure, dtypes and shapes are those of the space, and the others."""
    exact: dict[str, _Rows] = {}
    nonconforming: dict[str, _Rows] = {}
    for turn in episode.turns:
        strange = turn.nonconforming
        for agent, value in turn.observations.items():
            if agent in known:
                is_nonconforming = "obs" in strange.get(agent, ())
                rows = (nonconforming if is_nonconforming else exact).setdefault(agent, _Rows())
                rows.turns.append(turn)
                rows.values.append(value)
    return exact, nonconforming


def _looked(
    evidence: ProbeEvidence,
    episode: Episode,
    turn: Turn,
    agent: str,
    space: Any,
    value: Any,
    kind: str,
    with_masks: bool = True,
) -> Case:
    found = next(
        (each for each in misfits(space, value) if _is_meant(each, kind, with_masks)), None
    )
    if found is None:
        return Case(episode.at(turn, agent, "observations"), True)
    where = episode.at(turn, agent, f"observations{found.path}")
    proof = misfit_proof(evidence.api, agent, found)
    return Case(
        where, False, found.expected, found.actual, proof, severity=LOW if found.is_taken else None
    )


def _is_of_another_kind(space: Any, rows: _Rows) -> bool:
    """Tells whether a value as a whole is of another kind than its space says."""
    found = (each for value in rows.values for each in misfits(space, value))
    return any(each.kind == STRUCTURE and not each.path for each in found)


def _is_meant(found: Misfit, kind: str, with_masks: bool) -> bool:
    return found.kind == kind and (with_masks or not found.path.endswith(MASK_PATH))


def _is_told(agent: str, space: Any, actions: Any, rows: _Rows, kind: str) -> bool:
    """The checks of masks, which look at who may move, tell of this agent's masks anyway."""
    return any(
        each.kind == kind and each.path.endswith(MASK_PATH)
        for turn, value in zip(rows.turns, rows.values, strict=True)
        if agent not in turn.ended and (kind == DTYPE or _has_odd_length(actions, value))
        for each in misfits(space, value)
    )


def _has_odd_length(actions: Any, value: Any) -> bool:
    """Tells whether the mask of an observation hasn't one number for each action."""
    mask = value.get(MASK) if isinstance(value, dict) else None
    if not isinstance(actions, Discrete) or not isinstance(mask, np.ndarray):
        return False
    return bool(mask.shape != (int(actions.n),))


def misfit_proof(api: str, agent: str, found: Misfit) -> str:
    """Lines that raise as long as what the agent is given misses its space."""
    if api == "parallel":
        chosen = [
            f"agent = next(a for a in observations if str(a) == {agent!r})",
            "value, space = observations[agent], env.observation_space(agent)",
        ]
    else:
        chosen = ["value, space = env.last()[0], env.observation_space(env.agent_selection)"]
    return "\n".join([*chosen, f"assert {found.test}, value"])


@check("GK211", HIGH, "rollout", "spaces")
def observations_have_the_form_of_their_space(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every observation has the type and the keys that its observation space describes.

    A policy reads `observation["action_mask"]` or `observation.shape` at every turn, also at an
    agent's last one: a list, None, or a dictionary without a key makes it crash there.

    Bad:
        return {"observation": board}                        # the space also has "action_mask"

    Good:
        return {"observation": board, "action_mask": mask}

    Fix: give what the space describes: arrays for a Box, every key of a Dict and no other
    """
    yield from misfit_cases(evidence, STRUCTURE)


@check("GK212", MEDIUM, "rollout", "spaces")
def observations_have_the_dtype_of_their_space(
    contract: Contract, evidence: ProbeEvidence
) -> Cases:
    """Every observation has the dtype of its observation space.

    Buffers and networks are made for the dtype of the space; float64 that comes where float32 is
    declared is outside the space, and rounded, or refused, far from here.

    Bad:
        return np.array([x, y])                              # float64, the space says float32

    Good:
        return np.array([x, y], dtype=np.float32)

    Fix: convert observations to the dtype of the space: np.asarray(value, space.dtype)
    """
    yield from misfit_cases(evidence, DTYPE)


@check("GK213", HIGH, "rollout", "spaces")
def observations_have_the_shape_of_their_space(
    contract: Contract, evidence: ProbeEvidence
) -> Cases:
    """Every observation has the shape of its observation space, whichever agents are left.

    Networks have one input size. A shape that changes when another agent leaves or joins shows only
    in the episodes where that happens.

    Bad:
        return np.concatenate([self.position[a] for a in self.agents])   # shrinks with the agents

    Good:
        return np.concatenate([self.position[a] for a in self.possible_agents])

    Fix: give arrays of one shape, and declare that shape; pad what varies
    """
    yield from misfit_cases(evidence, SHAPE)


@check("GK214", HIGH, "rollout", "spaces")
def observations_are_within_their_space(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every observation is within the bounds of its observation space, also at an agent's end.

    Learners scale by the bounds, and one-hot encode by the number of values: what is outside
    is squashed, indexes past an array, or is refused by a checker in the middle of a training.

    Bad:
        spaces.Box(-1, 1, (2,))                              # and the robot may leave the square

    Good:
        spaces.Box(-np.inf, np.inf, (2,))                    # or keep the robot inside

    Fix: widen the bounds of the space to what the rules allow, or clip what is observed
    """
    yield from misfit_cases(evidence, BOUNDS)


@check("GK215", HIGH, "rollout", "spaces")
def observations_hold_no_nan(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """No observation holds NaN.

    One NaN makes every weight of a network NaN at its next update. It mostly comes from a mean over
    nobody or a division by zero, once the other agents have left.

    Bad:
        others = np.mean([self.position[b] for b in live if b != a], axis=0)   # NaN when alone

    Good:
        others = np.mean(...) if len(live) > 1 else np.zeros(2)

    Fix: say what is seen where there is nothing to see: a mean over nobody, a distance to nobody
    """
    yield from misfit_cases(evidence, NAN)


@check("GK216", MEDIUM, "rollout", "spaces", api="aec")
def others_can_be_observed(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`observe` gives an observation of its space for every live agent, also one not in turn.

    Conversions to Parallel, centralised critics and recorders observe all agents at every turn.
    What is wrong in agents' own turns too is left to the checks of those.

    Bad:
        def observe(self, agent):
            return self._view if agent == self.agent_selection else None

    Good:
        def observe(self, agent):
            return self._view_of(agent)

    Fix: let observe(agent) give an observation of the agent's space at any turn
    """
    facts = list(evidence.facts(OthersView))
    told = _in_turn(evidence) if any(fact.value.misfits for fact in facts) else frozenset()
    for fact in facts:
        value, agent = fact.value, str(fact.where.agent)
        wrong = [each for each in value.misfits if (each[0], each[1]) not in told]
        # the dtype of an action mask is told by its own check
        wrong = [each for each in wrong if each[0] != DTYPE or not each[1].endswith(MASK_PATH)]
        ok = value.failed is None and not wrong
        expected, seen, test = "an observation of its space", value.failed, "True"
        if wrong:
            _, path, what, seen, test = wrong[0]
            expected = f"{what} at observation{path}" if path else what
        proof = f"""\
agent = next(a for a in env.agents if str(a) == {agent!r})
value, space = env.observe(agent), env.observation_space(agent)
assert {test}, value"""
        yield Case(fact.where, ok, expected, seen, proof)


def _in_turn(evidence: ProbeEvidence) -> frozenset[tuple[str, str]]:
    """Kinds and paths of what observations miss in agents' own turns."""
    known = spaces_of(evidence, "observation")
    return frozenset(
        (each.kind, each.path)
        for episode in (*evidence["rollout"], *evidence["spaces"])
        for turn in episode.turns
        for agent, value in turn.observations.items()
        if agent in known
        for each in misfits(known[agent], value)
    )
