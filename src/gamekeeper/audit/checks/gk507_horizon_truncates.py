"""GK507."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._ticks import ticks_before
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Trace, Turn

OVER = {
    "parallel": "assert not env.agents, 'the episode goes on beyond its horizon'",
    "aec": "going_on = [a for a in env.agents if not (env.terminations[a] or env.truncations[a])]\n"
    "assert not going_on, going_on",
}
CUT = {
    "parallel": "assert any(truncations.values()), (terminations, truncations)",
    "aec": "assert any(env.truncations.values()), (env.terminations, env.truncations)",
}
TOO_EARLY = {
    "parallel": "early = [a for a in truncations if truncations[a] and not terminations.get(a)]\n"
    "assert not early, early",
    "aec": "flags = env.truncations\n"
    "early = [a for a in flags if flags[a] and not env.terminations[a]]\n"
    "assert not early, early",
}


def _undeclared(contract: Contract, evidence: Gathered) -> str | None:
    return "no horizon is declared" if contract.schedule.horizon is None else None


@check(
    "GK507",
    needs=("rollout",),
    severity=HIGH,
    mend="set truncations, not terminations, for all who are left in the tick that fills the "
    "declared horizon; or declare the horizon as it is",
    applies=_undeclared,
)
def the_declared_horizon_truncates(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An episode that reaches its declared horizon is truncated there: not terminated, not later.

    A time limit is no rule of the game: a learner that is told of a termination values the last
    state at nothing, and one that is cut early or late learns another game.

    Bad: `terminations = dict.fromkeys(self.agents, self.tick >= 200)`.

    Good: `truncations = dict.fromkeys(self.agents, self.tick >= 200)`.
    """
    horizon, api = contract.schedule.horizon or 0, evidence.api
    by_rule = any(each.kind == "truncation" for each in contract.endings.values())
    ended_by_rule: list[Occasion] = []
    is_truncated = False
    for trace in evidence["rollout"]:
        for turn, tick in ticks_before(trace, api):
            acting = [agent for agent in turn.order if agent not in turn.ended]
            is_late = tick >= horizon if api == "parallel" else tick > horizon
            if is_late and acting:
                yield Occasion(
                    trace.at(turn, None, "agents"), False, f"the end after {horizon} ticks",
                    f"{', '.join(acting)} acted in tick {max(tick, horizon + 1)}", proof=OVER[api],
                )  # fmt: skip
                break
            early = _cut(turn)
            if early and tick < horizon and not by_rule:
                yield Occasion(
                    trace.at(turn, early[0], "truncations"), False, f"nobody before tick {horizon}",
                    f"truncated after {tick}", proof=TOO_EARLY[api],
                )  # fmt: skip
                break
            if tick == horizon and turn.ended:
                is_truncated = is_truncated or bool(early)
                if early or _are_reasons_declared(contract, trace, turn):
                    yield Occasion(trace.at(turn, None, "truncations"), True)
                else:
                    ended_by_rule.append(Occasion(
                        trace.at(turn, None, "truncations"), False, "truncated by the time limit",
                        "terminated", proof=CUT[api],
                    ))  # fmt: skip
    # a rule may end one episode in its last tick by chance; not each of them
    if len(ended_by_rule) > 1 and not is_truncated:
        yield from ended_by_rule


def _cut(turn: Turn) -> list[str]:
    return sorted(a for a in turn.truncated if turn.truncated[a] and not turn.terminated.get(a))


def _are_reasons_declared(contract: Contract, trace: Trace, turn: Turn) -> bool:
    reasons = [trace.endings.get(agent) for agent in turn.ended]
    return all(reason in contract.endings for reason in reasons)
