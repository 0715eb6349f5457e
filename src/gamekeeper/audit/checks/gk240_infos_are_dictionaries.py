"""GK240."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK240",
    needs=("rollout",),
    severity=MEDIUM,
    mend="give every agent a dictionary for its info; an empty one where there is nothing to say",
)
def infos_are_dictionaries(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every agent's info is a dictionary, also in the step in which it ends; never None.

    Readers look into it with `info.get(...)` at every step, and crash in the rare one in which it
    is None, a list or a text.

    Bad:

        infos = {a: {"score": s} if a in self.agents else None for a in acting}

    Good:

        infos = {a: {"score": s} if a in self.agents else {} for a in acting}
    """
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            strange = turn.odd
            for agent in turn.infos:
                seen = strange.get(agent, {}).get("info")
                yield Occasion(
                    trace.at(turn, agent, "infos"), seen is None, "a dictionary",
                    None if seen is None else f"a {seen['type']}: {seen.get('value')!r}",
                    proof=_proof(evidence.api, agent),
                )  # fmt: skip


def _proof(api: str, agent: str) -> str:
    if api == "aec":
        return "info = env.last()[-1]\nassert isinstance(info, dict), info"
    return (
        f"info = next(infos[a] for a in infos if str(a) == {agent!r})\n"
        "assert isinstance(info, dict), info"
    )
