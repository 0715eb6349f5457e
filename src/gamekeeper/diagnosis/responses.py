"""The front of response tests: a recorded run in, a response test of each agent's policy out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from typing import Any, Final

import numpy as np

from gamekeeper.diagnosis.played_setup import OpenSetup, consent_to, setup_of
from gamekeeper.diagnosis.response_tests import FreshPlayer, ResponseTest, feed_of, response_test
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import EvidenceError
from gamekeeper.randomness.seeds import policy_rng
from gamekeeper.rollouts.interventions.fields import observed_fields
from gamekeeper.rollouts.interventions.perturbation import action_space, observation_space
from gamekeeper.runs.expanding import whole_evidence

FEEDS: Final = 3
"""Episodes that are fed."""


def responses(
    run: str | PathLike[str] | Evidence,
    *,
    env: object | None = None,
    policies: Mapping[str, Any] | None = None,
    seed: int = 0,
    allow_import: bool = False,
) -> dict[str, ResponseTest]:
    """Response tests of the policies of a run: lag, own randomness, memory, deaf fields.

    Each policy is fed with the observations that its agent was given in the first recorded
    episodes, and again with one field changed at one decision. The environment is opened for its
    spaces; it takes no step.

    Args:
        run: the folder of a run of level `full`, or evidence.
        env: opened in place of what the evidence names, with the recorded arguments.
        policies: in place of the recorded ones, by agent, role or under `*`.
        seed: of the changes and of the policies' draws.
        allow_import: run code that the evidence names.
    Returns:
        By agent; without those that no observations were recorded of.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: it names no policies, or holds no observations.
        RunError: there is no run.
        PolicyError: a policy can't be found, or raised.
    """
    evidence = whole_evidence(run, env=env, allow_import=allow_import)
    setup = setup_of(evidence, env=env, policies=policies)
    episodes = [episode for _, episode in zip(range(FEEDS), evidence.episodes, strict=False)]
    consent = consent_to(evidence, setup, env=env, policies=policies, allow_import=allow_import)
    with consent, OpenSetup(setup, evidence.contract) as stage:
        agents = [agent_name(agent) for agent in evidence.manifest.get("agents") or ()]
        found = responses_of(stage, episodes, agents, seed=seed)
    if not found:
        raise EvidenceError(
            "no observation of a decision was recorded",
            where=evidence.name,
            expected="a run of level full",
            fix="play it again into one: gamekeeper expand RUN OUT",
        )
    return found


def responses_of(
    stage: OpenSetup, episodes: Sequence[Episode], agents: Iterable[str], *, seed: int
) -> dict[str, ResponseTest]:
    """Response tests of the policies of an opened set-up, by agent.

    Args:
        agents: those that are tested.
    """
    found: dict[str, ResponseTest] = {}
    for name in agents:
        feeds = [feed for episode in episodes if (feed := feed_of(episode, name))]
        space = observation_space(stage.env, name)
        if feeds and space is not None:
            found[name] = response_test(
                _fresh(stage, name, seed),
                feeds,
                fields=observed_fields(stage.contract, name, space),
                space=action_space(stage.env, name),
                rng=np.random.default_rng([13, seed]),
            )
    return found


def _fresh(stage: OpenSetup, agent: str, seed: int) -> FreshPlayer:
    return lambda stream: stage.cast.apart(agent, policy_rng(seed, stream, agent))
