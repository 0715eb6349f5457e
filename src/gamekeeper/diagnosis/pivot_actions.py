"""Other actions of the agents at a turn: legal ones, samples, the policy's own, the reference's."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import to_json
from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.interface.policy import REFERENCE
from gamekeeper.rollouts.continuations import Continuations
from gamekeeper.rollouts.interventions.legal_actions import Offer, offer_of
from gamekeeper.runs.recording import cast_of

DRAWN: Final = "policy"
LEGAL: Final = "legal"
SAMPLE: Final = "sample"
MOST_LEGAL: Final = 12
"""Legal actions of an agent that are tried; of more as many are drawn."""
SAMPLES: Final = 4
"""Samples of a space that isn't Discrete."""


@dataclass(frozen=True, slots=True)
class ActionOption:
    """An action of one agent in place of its recorded one.

    Attributes:
        agent: as the environment knows it.
        source: `policy`: whatever its policy chooses; `legal`, `sample` or `reference`.
        action: the action; None for its policy's.
    """

    agent: Any
    source: str
    action: Any = None

    @property
    def text(self) -> str:
        """The action as text."""
        return to_json(self.action)


@dataclass(frozen=True, slots=True)
class ActionOptions:
    """Actions that can be tried in an episode.

    Attributes:
        play: gives what agents see at a turn.
        contract: names masks and noops.
        reference: the environment's own reference policy, if it has one.
        seed: of samples.
    """

    play: Continuations
    contract: Contract
    reference: JointPolicy | None
    seed: int = 0

    def at(self, turn: int) -> Iterator[ActionOption]:
        """Yields the actions in place of each recorded one of a turn."""
        recorded, inputs = self.play.course.actions[turn], self.play.inputs(turn)
        for place, (agent, action) in enumerate(recorded.items()):
            if action is None or agent not in inputs:  # an ended agent's
                continue
            yield ActionOption(agent, DRAWN)
            offer = offer_of(self.contract, self.play.course.env, agent)
            rng = np.random.default_rng([13, self.seed, turn, place])
            if offer is not None:
                offer.take(*inputs[agent])
                yield from _others(offer, agent, action, rng)
            is_short = offer is not None and _is_listed(offer)
            if self.reference is not None and not is_short:
                yield ActionOption(agent, REFERENCE, self.reference.act(agent, *inputs[agent]))


def reference_of(env: Any, contract: Contract) -> JointPolicy | None:
    """The environment's own reference policy, if it has one."""
    own = getattr(env.unwrapped, "policies", None)
    if not isinstance(own, Mapping) or REFERENCE not in own:
        return None
    return cast_of(REFERENCE, env, contract)


def _is_listed(offer: Offer) -> bool:
    return isinstance(offer.space, Discrete) and int(offer.space.n) <= MOST_LEGAL


def _others(
    offer: Offer, agent: Any, recorded: Any, rng: np.random.Generator
) -> Iterator[ActionOption]:
    space = offer.space
    if isinstance(space, Discrete):
        every = range(int(space.start), int(space.start + space.n))
        legal = [each for each in every if each != int(recorded) and offer.allows(each)]
        if len(legal) > MOST_LEGAL:
            legal = sorted(rng.choice(legal, MOST_LEGAL, replace=False).tolist())
        yield from (ActionOption(agent, LEGAL, space.dtype.type(each)) for each in legal)
        return
    own = copy.deepcopy(space)
    own.seed(int(rng.integers(1 << 31)))
    drawn = [own.sample() for _ in range(SAMPLES)]
    yield from (ActionOption(agent, SAMPLE, each) for each in drawn if offer.allows(each))
