"""Agents that are acquitted: another policy in their place fails as well, and by the same undo not.

What one agent says in a wrong way another may misread, so that undos at either of them restore
success. A whole policy in the place of one of them tells which: it makes up for all that is wrong
inside that agent, so that the undo is needed no longer where the fault was there.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from gamekeeper.diagnosis.experiment import Experiment
from gamekeeper.diagnosis.open_setup import OpenSetup
from gamekeeper.diagnosis.response_tests import Feed, actions_fed
from gamekeeper.diagnosis.trials import POLICY, IdealSubstitute, joined
from gamekeeper.statistics.significance import fisher_exact

EPISODES: Final = 10
"""Failing episodes on which a policy is tried in an agent's place, without an undo and with it."""
SURE: Final = 0.05
"""A p-value below which the undo makes a difference there."""
RESTORED: Final = 0.8
"""The part of these episodes that succeed with both."""


def acquit(
    experiment: Experiment,
    swaps: Sequence[IdealSubstitute],
    feeds: Mapping[str, Sequence[Feed]],
    roles: Mapping[str, str],
) -> None:
    """Notes the agents that can't be at fault, where undos leave open which of several is.

    Args:
        swaps: policies that may be tried in an agent's place.
        feeds: what agents were given, for policies that may go by their agent's name.
        roles: by agent.
    """
    for scope in experiment.open_scopes:
        finding = experiment.finding(scope)
        undos = [one for one in finding.substitutes if one.undo is not None and one.agents]
        blamed = dict.fromkeys(agent for one in finding.substitutes for agent in one.concerned)
        if finding.answer != "ambiguous" or len(blamed) < 2 or finding.substitutes != (*undos,):
            continue
        together = {agent for one in undos if len(one.agents) > 1 for agent in one.agents}
        cleared = {
            agent
            for agent in blamed
            if agent not in together  # a peer may have its fault, too
            for others in [[other for other in roles if roles[other] == roles[agent]]]
            for one in [_swap_of(experiment, agent, others, swaps, feeds[agent])]
            if one is not None and _needs(experiment, one, undos, scope)
        }
        if not all(set(one.agents) <= cleared for one in undos):
            experiment.acquitted |= cleared


def _swap_of(
    experiment: Experiment,
    agent: str,
    others: Sequence[str],
    swaps: Sequence[IdealSubstitute],
    feeds: Sequence[Feed],
) -> IdealSubstitute | None:
    """The first policy to be tried in an agent's place that does the same by others' names.

    One that goes by a table of all agents may have the fault of the agent that it replaces.
    """
    for one in swaps:
        if one.component == POLICY and not one.parts and one.agents == (agent,):
            setup, policy = experiment.setup, one.steps[0][3]
            said = []
            for name in others:
                with OpenSetup(setup.with_policy(name, policy), experiment.contract) as opened:
                    said.append(actions_fed(opened, name, feeds))
            if all(each == said[0] for each in said):
                return one
    return None


def _needs(
    experiment: Experiment, swap: IdealSubstitute, undos: Sequence[IdealSubstitute], scope: str
) -> bool:
    """Tells whether episodes fail with a policy in an agent's place, and with an undo too don't."""
    undo = min(undos, key=lambda one: set(swap.agents) <= set(one.agents))
    both, episodes = joined((swap, undo)), experiment.failing[:EPISODES]
    if experiment.runner.left < 2 * len(episodes):
        experiment.not_played.append(f"{both.name}, to tell whose it is")
        return False
    experiment.groups |= {one.name: one for one in (swap, both)}
    experiment.play([swap.name, both.name], experiment.search_seed, episodes)
    if {swap.name, both.name} & experiment.runner.broken.keys():
        return False
    without, restored = (
        sum(
            experiment.success(outcome, scope) > 0
            for outcome in experiment.runner.of(one.name, experiment.search_seed, episodes)
        )
        for one in (swap, both)
    )
    n = len(episodes)
    p = fisher_exact(n - without, n, n - restored, n)
    return restored >= RESTORED * n and restored > without and p < SURE
