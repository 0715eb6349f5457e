"""Checks of time limits: they truncate, and endings are of their declared kind."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, Case, Cases, check
from gamekeeper.checks.ended_agents import tells_both_flags, ticks_before
from gamekeeper.checks.facts.episode_facts import NearLimit
from gamekeeper.checks.facts.surface_facts import TimeLimits
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import no_termination_alone, no_truncation_alone
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn

WHOLE = 3
"""Whole episodes of one length that tell of a limit; fewer may be equal by chance."""

OVER = {
    "parallel": "assert not env.agents, 'the episode goes on beyond its horizon'",
    "aec": "going_on = [a for a in env.agents if not (env.terminations[a] or env.truncations[a])]\n"
    "assert not going_on, going_on",
}
CUT = {
    "parallel": "assert any(truncations.values()), (terminations, truncations)",
    "aec": "assert any(env.truncations.values()), (env.terminations, env.truncations)",
}


@check(
    "GK507",
    HIGH,
    "rollout",
    "surface",
    applies=lambda c, _: "no horizon is declared" if c.schedule.horizon is None else None,
    looks_at="an episode that reaches the declared horizon: a larger --budget takes more steps",
)
def the_declared_horizon_truncates(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An episode that reaches its declared horizon is truncated there: not terminated, not later.

    A time limit is no rule of the game: a learner that is told of a termination values the last
    state at nothing, and one that is cut early or late learns another game.

    An agent that is cut early by an ending that the contract declares, and the environment names,
    is right. Where no reason is named and a truncation is declared, or the early ending terminates,
    it is another limit than the declared one only where every whole episode, three at least, ends
    all of its agents in one and the same tick before the horizon, and no episode goes beyond it.

    Bad: `terminations = dict.fromkeys(self.agents, self.tick >= 200)`.

    Good: `truncations = dict.fromkeys(self.agents, self.tick >= 200)`.

    Fix: set truncations, not terminations, for all who are left in the tick that fills the declared
    horizon; or declare the horizon as it is
    """
    if not tells_both_flags(evidence):
        return
    horizon, api = contract.schedule.horizon or 0, evidence.api
    yield from _other_limit(contract, evidence, horizon)
    by_rule = any(each.kind == "truncation" for each in contract.endings.values())
    ended_by_rule: list[Case] = []
    is_truncated = False
    for episode in evidence["rollout"]:
        for turn, tick in ticks_before(episode, api):
            acting = [agent for agent in turn.order if agent not in turn.ended]
            is_late = tick >= horizon if api == "parallel" else tick > horizon
            if is_late and acting:
                where = episode.at(turn, None, "agents")
                seen = f"{', '.join(acting)} acted in tick {max(tick, horizon + 1)}"
                yield Case(where, False, f"the end after {horizon} ticks", seen, OVER[api])
                break
            early = _cut(turn)
            if early and tick < horizon and not by_rule:
                where = episode.at(turn, early[0], "truncations")
                expected = f"nobody before tick {horizon}"
                proof = reproducer_of(no_truncation_alone, api=api)
                yield Case(where, False, expected, f"truncated after {tick}", proof)
                break
            if tick == horizon and turn.ended:
                is_truncated = is_truncated or bool(early)
                where, expected = (
                    episode.at(turn, None, "truncations"),
                    "truncated by the time limit",
                )
                if early or _are_reasons_declared(contract, episode, turn):
                    yield Case(where, True)
                else:
                    ended_by_rule.append(Case(where, False, expected, "terminated", CUT[api]))
    # a rule may end one episode in its last tick by chance; not each of them
    if len(ended_by_rule) > 1 and not is_truncated:
        yield from ended_by_rule


def _other_limit(contract: Contract, evidence: ProbeEvidence, horizon: int) -> Cases:
    """Whole episodes that all end in one tick before the horizon, for no declared reason."""
    api = evidence.api
    ends: list[tuple[Episode, Turn, int]] = []
    longest = 0
    for episode in evidence["rollout"]:
        first = None
        for turn, tick in ticks_before(episode, api):
            if set(turn.order) - turn.ended:
                longest = max(longest, tick + (api == "parallel"))
            if first is None and turn.ended:
                first = turn, tick
        if first is not None and episode.header.get("end") == "ended":
            ends.append((episode, *first))
    limits = {tick for _, _, tick in ends}
    if len(ends) < WHOLE or len(limits) > 1 or min(limits) >= horizon or longest > min(limits):
        return
    declared = {each.kind for each in contract.endings.values()}
    for episode, turn, tick in ends:
        is_cut = bool(_cut(turn))
        is_explained = bool(episode.endings) and _are_reasons_declared(contract, episode, turn)
        if is_explained or not _is_last(episode, turn):
            continue
        if is_cut and "truncation" not in declared:
            continue  # judged as any early truncation
        if not is_cut and "termination" in declared and tick not in _limits(evidence).values():
            continue  # games of one length end so by their rules
        where = episode.at(turn, sorted(turn.ended)[0], "truncations" if is_cut else "terminations")
        expected = f"a time limit of {horizon} ticks, as declared"
        seen = f"each of {len(ends)} whole episodes {'cut' if is_cut else 'over'} after {tick}"
        proof = reproducer_of(no_truncation_alone if is_cut else no_termination_alone, api=api)
        yield Case(where, False, expected, seen, proof, confidence=0.9)


def _cut(turn: Turn) -> list[str]:
    return sorted(a for a in turn.truncated if turn.truncated[a] and not turn.terminated.get(a))


def _are_reasons_declared(contract: Contract, episode: Episode, turn: Turn) -> bool:
    reasons = [episode.endings.get(agent) for agent in turn.ended]
    return all(reason in contract.endings for reason in reasons)


PLAYS = 2
"""By chance a rule ends an episode in its last tick once, not again and again."""
OFTEN = 5
"""Plays whose agents end together at a limit, where most episodes end before it."""


def _declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    is_declared = contract.schedule.horizon is not None
    return "the horizon is declared, so GK507 judges it" if is_declared else None


@check(
    "GK508",
    LOW,
    "surface",
    "rollout",
    "near_limit",
    confidence=0.6,
    applies=_declared,
    looks_at="an episode that reaches an attribute, constant or parameter called like a limit, "
    "such as `max_steps`: raise --budget, or declare the horizon in a contract",
)
def time_limits_truncate(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A time limit truncates an episode, it doesn't terminate it.

    Learners bootstrap past a truncation, and not past a termination: told the one for the other
    they value the states before the limit at nothing.

    A heuristic, as nobody has declared a limit: an attribute, a constant of the module or a
    parameter that is called like one (`max_steps`, `horizon`, `LIMIT`) holds the very number of
    ticks after which episodes end by termination, in two episodes or more and in half of those that
    came to an end, or in five episodes of several agents at once, and thrice as often as in any
    other tick; none lasts longer, and nothing was ever truncated. A rule that ends games then by
    chance, as a battery that is empty in the last tick, would have to do so again and again.

    Bad: `terminations = dict.fromkeys(agents, time >= self.max_time)`.

    Good: `truncations = dict.fromkeys(agents, time >= self.max_time)`.

    Fix: truncate where time is up: `truncations = dict.fromkeys(agents, time >= max_time)`; if the
    last tick is a rule of the environment, declare it in the contract's endings as a termination
    """
    if any(ending.kind == "termination" for ending in contract.endings.values()):
        return
    if not tells_both_flags(evidence):
        return
    looks = (*evidence.looks.get("surface", ()), *evidence.looks.get("rollout", ()))
    episodes = [episode for look in looks for episode in look.episodes]
    limits = {
        name: value
        for name, value in _limits(evidence).items()
        if not any(_lasts_longer(evidence.api, episode, value) for episode in episodes)
    }
    found = [each for episode in episodes for each in _at_the_limit(evidence.api, episode, limits)]
    is_truncated = any(_is_truncated(turn) for episode in episodes for turn in episode.turns)
    whole = sum(episode.header.get("end") == "ended" for episode in episodes)
    least = max(min(PLAYS, len(episodes)), whole / 2)
    is_sure = not is_truncated and (
        sum(not each.ok for each in found) >= least
        or _stands_out(evidence.api, episodes, limits.values())
    )
    yield from (each for each in found if each.ok or is_sure)
    yield from _at_near_limits(evidence, episodes)


def _at_near_limits(evidence: ProbeEvidence, episodes: Sequence[Episode]) -> Cases:
    """Ends of episodes that were played to a limit, if each ends in its tick.

    One of an instance's own is judged so where the other episodes are shorter.
    """
    ticks = (tick for each in episodes for _, tick in ticks_before(each, evidence.api))
    longest = max(ticks, default=0)
    found: list[Case | None] = []
    for look in evidence.looks.get("near_limit", ()):
        near = look.fact(NearLimit)
        options = near.value.options if near else {}
        named = near.value.limits.items() if near else ()
        limits = {name: value for name, value in named if options or value > longest}
        if limits:
            case = next(_at_the_limit(evidence.api, look.episodes[0], limits, options), None)
            found.append(case)
    cases = [each for each in found if each is not None]
    least = min(PLAYS, len(evidence.looks.get("near_limit", ())))
    if len(cases) == len(found) and (len(cases) >= least or any(each.ok for each in cases)):
        yield from cases


def _stands_out(api: str, episodes: Sequence[Episode], limits: Collection[int]) -> bool:
    """Tells whether a limit's tick ends all who are left, two or more, as no other tick does."""
    at_once: dict[Any, int] = {}
    for episode in episodes:
        for turn, tick in ticks_before(episode, api):
            if len(turn.ended) > 1 and _is_last(episode, turn):
                at_once.setdefault(episode.header.get("seed"), tick)
    (tick, most), *others = [*Counter(at_once.values()).most_common(2), (0, 0)]
    return tick in limits and most >= max(OFTEN, 3 * others[0][1] if others else 0)


def _limits(evidence: ProbeEvidence) -> dict[str, int]:
    """Names of limits that hold one number in all episodes."""
    found = [fact.value.limits for fact in evidence.facts(TimeLimits)]
    return {
        name: value
        for name, value in (found[0] if found else {}).items()
        if all(each.get(name) == value for each in found)
    }


def _lasts_longer(api: str, episode: Episode, limit: int) -> bool:
    """Tells whether an agent acts once that many ticks are over."""
    over = limit if api == "parallel" else limit + 1  # where the last tick is still under way
    return any(
        tick >= over and not set(turn.order) <= turn.ended
        for turn, tick in ticks_before(episode, api)
    )


def _at_the_limit(
    api: str, episode: Episode, limits: Mapping[str, int], options: Mapping[str, int] | None = None
) -> Cases:
    """The turn, if there is one, at which a limit is met and somebody ends."""
    for turn, tick in ticks_before(episode, api):
        names = [name for name, value in limits.items() if value == tick]
        if names and turn.ended and _is_last(episode, turn):
            where = episode.at(turn, None, "terminations")
            is_ok = any(turn.truncated.values())
            expected = f"truncated after {tick} ticks, as {names[0]} = {tick}"
            seen = f"terminated: {', '.join(sorted(turn.ended))}"
            proof = reproducer_of(no_termination_alone, api=api, options=options)
            yield Case(where, is_ok, expected, seen, proof)
            return


def _is_truncated(turn: Turn) -> bool:
    """Somebody is; or a flag that is no bool may say so."""
    return any(turn.truncated.values()) or any(
        "truncated" in nonconforming for nonconforming in turn.nonconforming.values()
    )


def _is_last(episode: Episode, turn: Turn) -> bool:
    """Tells whether no agent that hasn't ended acts from here on."""
    rest = (each for each in episode.turns if each.index >= turn.index)
    ended = set(turn.ended)
    for each in rest:
        ended |= each.ended
        if not set(each.order) <= ended:
            return False
    return True


FLAGS = {"termination": "terminated", "truncation": "truncated"}


def _no_ending_kind(contract: Contract, evidence: ProbeEvidence) -> str | None:
    if not contract.endings:
        return "no endings are declared"
    named = any(episode.endings for episode in evidence["rollout"])
    return None if named else "the environment names no reasons in `endings`"


@check(
    "GK509",
    HIGH,
    "rollout",
    applies=_no_ending_kind,
    looks_at="an ending that the contract declares",
)
def endings_are_of_their_declared_kind(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An ending that is declared a truncation truncates, one declared a termination terminates.

    A learner bootstraps past a truncation and not past a termination: told the one for the other
    it values the states before it wrongly.

    Bad: `battery = { kind = "truncation" }` in the contract, `self.terminate(agent, "battery")` in
    the rules.

    Good: `self.truncate(agent, "battery")`.

    Fix: set the flag that the contract declares for the reason, or declare the reason's kind as it
    is: limits from outside truncate, rules of the task terminate
    """
    for episode in evidence["rollout"]:
        for turn in episode.turns:
            for agent in sorted(turn.ended):
                reason = episode.endings.get(agent)
                declared = None if reason is None else contract.endings.get(reason)
                if declared is None or declared.kind is None:
                    continue
                flag = FLAGS[declared.kind]
                other = next(kind for kind in FLAGS if kind != declared.kind)
                where = episode.at(turn, agent, "endings")
                is_ok = bool(getattr(turn, flag).get(agent))
                proof = _proof(evidence.api, agent, declared.kind)
                yield Case(where, is_ok, f"a {declared.kind} by {reason!r}", f"a {other}", proof)


def _proof(api: str, agent: str, kind: str) -> Reproducer:
    book = f"{kind}s" if api == "parallel" else f"env.{kind}s"
    flags = f"{{str(a): flag for a, flag in {book}.items()}}"
    return Reproducer(f"flags = {flags}\nassert flags.get({agent!r}), flags")
