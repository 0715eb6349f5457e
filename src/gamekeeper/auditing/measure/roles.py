"""Symmetry of roles, and whose move counts where two exclude each other. Pure."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.measure.trials import one_way_pairs
from gamekeeper.checks.endings.role_symmetry import FEWEST, exchangeable, p_by_role
from gamekeeper.checks.facts.form_facts import DrawnPriority, EpisodeShape, MoveTrial
from gamekeeper.checks.probe_evidence import Fact
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import role
from gamekeeper.statistics.significance import holm

LEVEL: Final = 0.01
"""Chance of calling interchangeable agents different, over all roles together."""
ALIKE: Final = 10
"""Effects one way, all along one order of the names: by chance with probability 2 / 1,024."""
CONFIRMED: Final = 2
"""Pairs of which the effect goes the same way in several futures."""
TURNED: Final = 2
"""Effects that went the other way with another draw, for a word on random conflicts."""
PART: Final = 0.2
"""Part of all pairs that were tried in which it has to be so."""


def symmetric(
    shapes: Sequence[EpisodeShape],
    episodes: Sequence[Episode],
    roles: Mapping[str, Sequence[str]],
    first_comes: Mapping[str, str],
) -> dict[str, dict[str, Any]] | None:
    """By role of two agents at least, whether its agents could exchange names.

    Args:
        shapes: episodes whose fares are permuted among the agents that were there at the start.
        episodes: rollouts, likewise; each of the two has half of the level.
        roles: the agents of each.
        first_comes: roles in which an order of names decides, and the reason.
    """
    p_values: dict[str, float] = {}
    for name, agents in roles.items():
        there = np.array([[agent in s.fares for agent in agents] for s in shapes], np.bool_)
        there = there.reshape(-1, len(agents))
        if (there.sum(axis=1) > 1).sum() >= FEWEST:
            blank = (0.0,) * 5
            rows = np.array([[s.fares.get(agent, blank) for agent in agents] for s in shapes])
            value = exchangeable(rows, there)
            if value is not None:
                p_values[name] = value
    for name, value in p_by_role(episodes, roles).items():
        p_values[name] = min(1.0, 2 * min(value, p_values.get(name, 1.0)))
    corrected = dict(zip(p_values, holm(list(p_values.values())), strict=True))
    found: dict[str, dict[str, Any]] = {}
    for name, agents in roles.items():
        if len(agents) < 2 or not (name in corrected or name in first_comes):
            continue
        p = corrected.get(name)
        seems = name not in first_comes and p is not None and bool(p > LEVEL)
        found[name] = {
            "seems": seems,
            "p": None if p is None else round(p, 4),
            "n": len(shapes) + len(episodes),
        }
        if name in first_comes:
            found[name]["why"] = first_comes[name]
    return found or None


def priority(
    facts: Sequence[DrawnPriority], trials: Sequence[Fact[MoveTrial]], agents: Collection[str]
) -> tuple[str | None, frozenset[str]]:
    """`roster` where the earlier agent's move always counts, `random` where a draw settles it.

    With the roles in which it does. None where effects between agents of a role go both ways, or
    there are none; `unclear` where all go one way, and too few were seen to exclude chance; `noisy`
    where a draw settles that there is an effect, and it wasn't seen to turn one.

    Args:
        facts: pairs of one role of which one's move changes the other's reward, in several futures.
        trials: moves that were replaced, those of a round against each other.
        agents: in the order of the roster.
    """
    turned = sum({(True, False), (False, True)} <= set(fact.ways) for fact in facts)
    if turned >= TURNED and turned >= PART * len(facts):
        return "random", frozenset()
    varied = sum(len(set(fact.ways)) > 1 for fact in facts)
    place = {agent: at for at, agent in enumerate(agents)}
    pairs = [pair for pair in one_way_pairs(trials) if pair[0] in place and pair[1] in place]
    ways = {place[one] < place[two] for one, two in pairs}
    if len(ways) != 1 or turned:
        is_noisy = turned or (varied and varied >= PART * len(facts))
        return "noisy" if is_noisy else None, frozenset()
    ranked = frozenset(role(one) for one, _ in pairs)
    firm = sum(set(fact.ways) == {(True, False)} for fact in facts)
    if len(pairs) < ALIKE or firm < CONFIRMED:
        return "unclear", ranked
    return "roster", ranked
