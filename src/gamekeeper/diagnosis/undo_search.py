"""The search for an undo from outside: screened on a few failing seeds, confirmed on fresh ones."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import combinations, islice, pairwise, product
from typing import Any, Final

from gamekeeper.diagnosis.acquittals import acquit
from gamekeeper.diagnosis.experiment import SEARCH, UNCHANGED, Experiment, fresh_seed
from gamekeeper.diagnosis.judgement import EITHER, OR_DRAWN, OR_KEPT, SCALES, ScopeFinding
from gamekeeper.diagnosis.message_channels import (
    MOST_AGENTS,
    PROBED,
    MessageChannel,
    between,
    channels_of,
    deliveries,
    sound_ways,
)
from gamekeeper.diagnosis.open_setup import OpenSetup
from gamekeeper.diagnosis.response_tests import ResponseTest, feed_of, responses_of
from gamekeeper.diagnosis.trials import (
    CARRIED,
    MEMORY,
    POLICY,
    IdealSubstitute,
    joined,
    peers_of,
    roles_of,
    undone,
)
from gamekeeper.diagnosis.undo_candidates import DRAWN, candidates_of, is_either, is_unmoved
from gamekeeper.diagnosis.undos import BoundaryUndo
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.layout import agent_name
from gamekeeper.rollouts.interventions.fields import acted_fields
from gamekeeper.rollouts.interventions.perturbation import action_space

RECORDED: Final = 10
"""Recorded episodes that tell which values occur."""
EACH: Final = 40
"""Observations of an agent that are looked at in each of them, at most."""
FED: Final = 2
"""Episodes whose observations the response tests feed."""
ROUNDS: Final = (2, 4, 7, 10)
"""Failing episodes on which undos are played, round by round."""
HALF: Final = 0.5
"""The part of those that has to succeed for an undo to stay in."""
RIVAL: Final = 0.8
"""The part from which an undo that was left out for want of budget could be as good as one in."""
CONFIRMED: Final = 5
"""Undos that are confirmed at most."""
ASIDE: Final = 24
"""Episodes that stay for counterfactuals and recordings of what restores."""
NONE: Final = ("unexplained", "not_tried")
"""Answers with which two undos at once are tried."""
UNDONE: Final = 0.75
"""The part of what is left of the budget that undos get."""


def try_undos(experiment: Experiment, episodes: Iterable[Episode] = ()) -> dict[str, ResponseTest]:
    """Tries undos and peers' policies where it fails and no label was found, within the budget.

    Where a peer's policy clearly restores in an agent's place, undos are tried at that agent alone.

    Args:
        experiment: it has run; gets the undos that were confirmed.
        episodes: recorded ones; the first few tell the values that occur in a field.
    Returns:
        Response tests by agent, which left out the undos that they contradict; empty where no undo
        was wanted.
    """
    failing_ones = filter(experiment.is_failing, experiment.scopes)
    experiment.open_scopes = [x for x in failing_ones if _is_open(experiment.finding(x))]
    failing = experiment.failing = _failing(experiment)
    if not failing or experiment.is_broken_off:
        return {}
    if experiment.runner.left < FED + experiment.confirm + len(failing[: ROUNDS[-1]]):
        experiment.not_played.append("undos from outside")
        return {}
    with OpenSetup(experiment.setup, experiment.contract) as open_setup:
        fed = [
            open_setup.played(experiment.search_seed, episode).episode for episode in failing[:FED]
        ]
        experiment.runner.extra += len(fed)
        named = [agent_name(agent) for agent in getattr(open_setup.env, "possible_agents", ())]
        agents = _suspects(experiment, named)
        responses = responses_of(open_setup, fed, named, seed=experiment.seed)
        feeds = {agent: [feed_of(episode, agent) for episode in fed] for agent in named}
        roles = roles_of(experiment.contract, named, open_setup.env)
        peers = [
            one
            for one in peers_of(experiment.setup, experiment.contract, named, open_setup.env)
            if one.agents[0] in agents
        ]
        experiment.undos = peers[: experiment.runner.left // (2 * ROUNDS[1])]
        ranked = ranked_undos(experiment, experiment.undos, ROUNDS[1])
        replaced = {one.agents[0] for one, share in ranked.items() if share >= RIVAL}
        undos = candidates_of(
            open_setup,
            responses,
            [a for a in agents if a in replaced or not replaced],
            _seen([*fed, *islice(episodes, RECORDED)], named),
        )
        kept = _kept(experiment)
        open_as = {undo: _open_as(undo, open_setup, responses, kept) for undo in undos}
        axes = {
            agent: len(acted_fields(space))
            for agent in named
            if (space := action_space(open_setup.env, agent)) is not None
        }
    channels = _channels(experiment, named)
    undos = [*deliveries(channels), *undos]
    touched = [
        undone(undo, undos, between(undo, channels, axes), open_as.get(undo, "")) for undo in undos
    ]
    renewals = [one for one in experiment.renewals if set(one.agents) & {*agents}]
    candidates = [*experiment.undos, *renewals, *touched]
    search(experiment, candidates)
    if all(experiment.finding(each).answer in NONE for each in experiment.open_scopes):
        search_pairs(experiment, touched)
    experiment.sound_ways = sound_ways(channels)
    acquit(experiment, [*experiment.substitutes, *peers], feeds, roles)
    return responses


def _open_as(
    undo: BoundaryUndo,
    open_setup: OpenSetup,
    responses: Mapping[str, ResponseTest],
    kept: Collection[str],
) -> str:
    """The place of a fault in words, where an undo leaves its label open.

    Args:
        kept: agents for which a reset of what they keep between turns restores.
    """
    if undo.way in SCALES and is_unmoved(undo.agents, responses):
        return POLICY
    if undo.way == "hold":
        known = [responses[agent] for agent in undo.agents if agent in responses]
        is_drawn = any(each.randomness >= DRAWN for each in known)
        return OR_KEPT if {*undo.agents} & {*kept} else OR_DRAWN if is_drawn else ""
    return EITHER if is_either(open_setup, undo) else ""


def _kept(experiment: Experiment) -> set[str]:
    """Agents for which something that they keep between turns restores once it is reset."""
    tried = [x for scope in experiment.open_scopes for x in experiment.finding(scope).tried]
    resets = [x.substitute for x in tried if x.restores and x.substitute.component == MEMORY]
    return {agent for one in resets for agent in one.agents}


def _seen(episodes: Sequence[Episode], agents: Sequence[str]) -> dict[str, list[Any]]:
    """Observations of agents' decisions, some of each episode."""
    return {
        agent: [
            observation
            for episode in episodes
            for feed in [feed_of(episode, agent, most=len(episode))]
            for observation, _ in feed[:: len(feed) // EACH + 1]
        ]
        for agent in agents
    }


def _channels(experiment: Experiment, agents: Sequence[str]) -> tuple[MessageChannel, ...]:
    """Messages between agents, where the budget has room to look for them."""
    cost = PROBED * len(agents) if 1 < len(agents) <= MOST_AGENTS else 0
    if not cost or experiment.runner.left < cost + 2 * experiment.confirm:
        return ()
    experiment.runner.extra += cost
    setup, contract = experiment.setup, experiment.contract
    seed = fresh_seed(experiment.fingerprint, experiment.seed, "messages")
    return channels_of(setup, contract, agents, seed=seed)


def _is_open(finding: ScopeFinding) -> bool:
    """No label was found but that of another cut-off, which yields to an undo."""
    if finding.answer != "protocol":
        return not finding.labels
    return all(one.cut_off == "default" for one in finding.substitutes)


def _failing(experiment: Experiment) -> list[int]:
    """Searched episodes that failed for one of the open scopes."""
    seed, scopes = experiment.search_seed, experiment.open_scopes
    rows = [experiment.successes(UNCHANGED, seed, SEARCH, scope) for scope in scopes]
    return [episode for episode in range(SEARCH) if any(row[episode] == 0 for row in rows)]


def _restoring(experiment: Experiment) -> list[IdealSubstitute]:
    """Undos that restore success for the open scopes."""
    scopes = experiment.open_scopes
    return [one for scope in scopes for one in experiment.finding(scope).substitutes]


def _suspects(experiment: Experiment, agents: Sequence[str]) -> list[str]:
    """The agents whose whole policy or memory restores success; all where none does."""
    concerned = {agent for one in _restoring(experiment) for agent in one.agents}
    return [agent for agent in agents if agent in concerned or not concerned]


def search(experiment: Experiment, candidates: Sequence[IdealSubstitute]) -> None:
    """Screens undos and swaps on ever more failing seeds, and confirms the best few.

    Args:
        candidates: likely ones first.
    """
    room = int(UNDONE * experiment.runner.left)
    count = min(max(room // (3 * experiment.confirm), 1), CONFIRMED)
    later = room // 4
    most = max((room - count * experiment.confirm - later) // ROUNDS[0], 0)
    pool, rest = list(candidates[:most]), list(candidates[most:])
    rivals, open_ones = list[IdealSubstitute](), list[IdealSubstitute]()
    experiment.undos = pool
    for at, until in pairwise((*ROUNDS, ROUNDS[-1])):
        ranked = ranked_undos(experiment, pool, at)
        if rest:
            more, rest, open_ones = _other_boundaries(experiment, ranked, rest, count, later)
            experiment.undos = [*pool, *more]
            ranked = ranked_undos(experiment, experiment.undos, at)
            if rest:
                text = f"{len(rest)} of {len(candidates)} undos from outside"
                experiment.not_played.append(text)
            rest = []
        kept = _of_each([one for one, share in ranked.items() if share >= HALF])
        each = max(min(until, len(experiment.failing)) - at, 1)
        cap = later // (len(ROUNDS) - 1) // each
        if until == at:
            affordable = (experiment.runner.left - ASIDE) // experiment.confirm
            cap = max(count, min(affordable, CONFIRMED))
        rivals += [one for one in kept[cap:] if ranked[one] >= RIVAL]
        pool = kept[:cap]
    pool += _beside(experiment, pool, rivals)
    pool = _with_parts(experiment, pool)
    experiment.dropped += len(experiment.undos) - len(pool)
    experiment.undos = pool
    named = {(one.component, one.agents) for one in pool}
    skipped = [
        one
        for one in (*rivals, *open_ones)
        if (one.component, one.agents) not in named
        and not any(set(each.agents) < set(one.agents) for each in pool)
    ]
    experiment.skipped += skipped
    experiment.rivals = [one for one in skipped if one in rivals]
    if experiment.rivals:
        experiment.not_played.append("confirming all undos that restored in the search")
    experiment.confirm_arms(pool)
    if any(CARRIED in one.component for one in _restoring(experiment)):
        # Each arm begins with fresh objects, so that a few episodes of any arm succeed by that.
        experiment.skipped = [one for one in experiment.skipped if one not in skipped]
        experiment.rivals = []


def _beside(
    experiment: Experiment, pool: Sequence[IdealSubstitute], rivals: Sequence[IdealSubstitute]
) -> list[IdealSubstitute]:
    """A policy in the place of an agent whose undo is confirmed, where the budget has room for it.

    It makes up for the undo, and so changes no answer; that it restores too is said beside it.
    """
    whose = {one.agents for one in pool}
    found = [one for one in rivals if one.component == POLICY and one.agents in whose]
    has_room = experiment.runner.left - ASIDE >= experiment.confirm * (len(pool) + 1)
    return found[:1] if has_room and not any(one.component == POLICY for one in pool) else []


def _with_parts(experiment: Experiment, pool: Sequence[IdealSubstitute]) -> list[IdealSubstitute]:
    """The same, with each part of several at once: they are joint only where no part restores.

    Two fresh objects of which that can't be afforded aren't confirmed.
    """
    renewed = {part for one in experiment.renewals for part in one.parts}
    parts = dict.fromkeys(part for one in pool for part in one.parts if part not in pool)
    if experiment.confirm * (len(pool) + len(parts)) <= experiment.runner.left - ASIDE:
        both = [one for one in pool if one.component == POLICY and len(one.parts) == 2]
        experiment.least |= {one.name for one in both}
        return [*pool, *parts]
    return [one for one in pool if not {*one.parts} & renewed & {*parts}]


def _other_boundaries(
    experiment: Experiment,
    ranked: Mapping[IdealSubstitute, float],
    rest: Sequence[IdealSubstitute],
    count: int,
    later: int,
) -> tuple[list[IdealSubstitute], list[IdealSubstitute], list[IdealSubstitute]]:
    """Undos that are tried after all, those that aren't, and those of these that could be rivals.

    Where an undo restores, another boundary of the same agents may do as well, or another agent's:
    the first's label is a guess until the one was tried, and its agents until the other was.

    Args:
        ranked: shares of those that were tried first.
        rest: those that weren't, likely ones first.
        count, later: undos to be confirmed, and episodes of later rounds, that stay affordable.
    """
    best = [one for one, share in ranked.items() if share >= RIVAL and one.undo is not None]
    if best and not any(one.undo is not None and one.undo.way in SCALES for one in best):
        rest = [one for one in rest if not one.is_offset]  # it does what a scale does at most
    named = {(one.component, one.agents) for one in best}
    whose = {one.agents for one in best}
    other = [o for o in rest if o.agents in whose and (o.component, o.agents) not in named]
    other += [o for o in rest if o.agents in whose and o not in other]
    same = len(other)
    other += [o for o in rest if best and o not in other]
    room = experiment.runner.left - count * experiment.confirm - later - ASIDE
    more = other[: max(room // ROUNDS[0], 0)]
    left = [one for one in rest if one not in more]
    return more, left, [one for one in other[:same] if one not in more]


def _of_each(ranked: Sequence[IdealSubstitute]) -> list[IdealSubstitute]:
    """The same, first the best of each component of the same agents: they could be rivals.

    Whole policies come after the undos among these: they make up for them, and have no label.
    """
    firsts: dict[tuple[str, tuple[str, ...]], IdealSubstitute] = {}
    for one in ranked:
        firsts.setdefault((one.component, one.agents), one)
    best = sorted(firsts.values(), key=lambda one: one.component == POLICY)
    return [*best, *(one for one in ranked if one not in best)]


# -- undos of two agents at once, where no undo of one restores: two faults may hide each other

WAYS: Final = (
    "mirror field",
    "exchange fields",
    "turn fields",
    "mirror axis",
    "exchange axes",
    "turn axes",
    "exchange actions",
    "settle",
)
"""Undos that are paired. Scales and constants at two agents would make up for an environment that
pushes both, as wind does, which is neither's fault."""
BATCH: Final = 48
"""Pairs that are played before those that restore are looked at."""
MOST_PAIRS: Final = 600
"""Pairs that are tried at most, one failing episode each."""
SCREENED: Final = (1, 4, 10)
"""Failing episodes on which pairs are played, round by round."""
RESERVED: Final = 4
"""Arms whose confirmation stays affordable."""
CONFIRMED_PAIRS: Final = 3
"""Pairs that are confirmed at most, each beside its two parts."""


def pairs_of(ranked: Sequence[IdealSubstitute]) -> list[IdealSubstitute]:
    """Pairs of undos of different agents, likely ones first.

    The same undo at both comes first (they may have learnt from one faulty source), then pairs of
    which both stand high.

    Args:
        ranked: undos of one agent or more, the best first.
    """
    units: dict[tuple[str, ...], list[IdealSubstitute]] = {}
    for one in ranked:
        undo = one.undo
        if undo is not None and undo.way in WAYS and not one.between:
            units.setdefault(one.agents, []).append(one)
    placed = [
        ((not _is_same(one, two), max(i, j), i + j), joined((one, two)))
        for mine, others in combinations(units.values(), 2)
        if not {*mine[0].agents} & {*others[0].agents}
        for (i, one), (j, two) in product(enumerate(mine), enumerate(others))
    ]
    return [pair for _, pair in sorted(placed, key=lambda each: each[0])]


def _is_same(one: IdealSubstitute, two: IdealSubstitute) -> bool:
    """Tells whether two undos do the same thing."""
    a, b = one.undo, two.undo
    return a is not None and b is not None and _form(a) == _form(b)


def _form(undo: object) -> tuple[object, ...]:
    return tuple(getattr(undo, name) for name in ("way", "places", "amount"))


def search_pairs(experiment: Experiment, undos: Sequence[IdealSubstitute]) -> None:
    """Screens pairs of undos on failing seeds, and confirms the best few beside their parts.

    Args:
        undos: of single agents; those of them that were searched are paired.
    """
    seed, outcomes = experiment.search_seed, experiment.runner.outcomes
    known = [one for one in undos if (one.name, seed, experiment.failing[0]) in outcomes]
    experiment.groups |= {one.name: one for one in known}
    pairs = pairs_of(list(ranked_undos(experiment, known, 1)))
    reserve = ASIDE + RESERVED * experiment.confirm
    most = max(min(experiment.runner.left - reserve, MOST_PAIRS), 0)
    tried: dict[str, IdealSubstitute] = {}
    found: list[IdealSubstitute] = []
    for at in range(0, most, BATCH):
        batch = pairs[at : min(at + BATCH, most)]
        found = _screened(experiment, batch, tried)
        if found:
            more = _beside_pair(found[0], pairs, tried)
            found += _screened(experiment, more, tried)
            break
    if len(tried) < len(pairs) and not found:
        experiment.not_played.append(f"{len(pairs) - len(tried)} of {len(pairs)} pairs of undos")
    last = ranked_undos(experiment, found, SCREENED[-1])
    _confirm_pairs(experiment, [one for one, share in last.items() if share >= HALF])
    experiment.paired = len(tried)


def _beside_pair(
    pair: IdealSubstitute, pairs: Sequence[IdealSubstitute], tried: Mapping[str, object]
) -> list[IdealSubstitute]:
    """Pairs that share a half with one that restores, and weren't tried: they may do as well."""
    return [
        other
        for other in pairs
        if other.name not in tried and any(part in pair.parts for part in other.parts)
    ]


def _screened(
    experiment: Experiment, pairs: Sequence[IdealSubstitute], tried: dict[str, IdealSubstitute]
) -> list[IdealSubstitute]:
    """Those of the pairs that restore on ever more failing seeds, the best first."""
    room = experiment.runner.left - RESERVED * experiment.confirm
    left = list(pairs[: max(room, 0)])
    tried |= {one.name: one for one in left}
    experiment.groups |= tried
    for count in SCREENED[:-1]:
        shares = ranked_undos(experiment, left, count)
        left = [one for one, share in shares.items() if share >= RIVAL]
    return left


def _confirm_pairs(experiment: Experiment, pairs: Sequence[IdealSubstitute]) -> None:
    """Plays the best pair of each kind, and the parts of each, on fresh seeds."""
    kinds: dict[object, IdealSubstitute] = {}
    for one in pairs:
        kinds.setdefault(tuple((part.component, part.agents) for part in one.parts), one)
    arms: list[IdealSubstitute] = []
    for one in list(kinds.values())[:CONFIRMED_PAIRS]:
        more = [each for each in (*one.parts, one) if each not in (*experiment.undos, *arms)]
        if (len(arms) + len(more)) * experiment.confirm <= experiment.runner.left - ASIDE:
            arms += more
    experiment.undos = [*experiment.undos, *arms]
    experiment.confirm_arms(arms)


def ranked_undos(
    experiment: Experiment, undos: Sequence[IdealSubstitute], count: int
) -> Mapping[IdealSubstitute, float]:
    """Shares of failing episodes that succeed with each undo, the best first, then by return."""
    seed, runner, episodes = experiment.search_seed, experiment.runner, experiment.failing[:count]
    experiment.play([one.name for one in undos], seed, episodes)
    played = [one for one in undos if one.name not in runner.broken]
    shares: dict[IdealSubstitute, tuple[float, float]] = {}
    for one in played:
        outcomes = runner.of(one.name, seed, episodes)
        parts = [
            sum(experiment.success(each, scope) for each in outcomes) / len(outcomes)
            for scope in experiment.open_scopes
            if not experiment.is_at_cost(one, seed, episodes, scope)
        ]
        shares[one] = max(parts, default=0.0), sum(each.team_return for each in outcomes)
    best = sorted(played, key=lambda one: shares[one], reverse=True)  # of equals the likelier
    return {one: shares[one][0] for one in best}
