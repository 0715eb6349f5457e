"""What checks share that read what the probe `extra_calls` saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from gamekeeper.audit.story import crossings_of, parting_words, story_proof
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.occasion import Occasion
from gamekeeper.core.proof import Proof

EVERYBODY = "for agent in env.agents:\n    "
MEDDLING = {
    "observe": f"{EVERYBODY}env.observe(agent)",
    "last": "env.last()",
    "state": "env.state()",
    "render": "env.render()",
    "spaces": f"{EVERYBODY}env.observation_space(agent), env.action_space(agent)",
    "sample": f"{EVERYBODY}env.action_space(agent).sample()\n"
    "    env.observation_space(agent).sample()",
    "attributes": "str(env), env.num_agents, env.max_num_agents, env.metadata, env.unwrapped",
}
"""What is called between the steps, as Python, by kind of call."""


def extra(evidence: Gathered, kind: str) -> Iterator[Occasion]:
    """An occasion for every play in which this kind of call was made more often.

    A play with calls of all kinds that went another way accuses none of them: each was tried alone.
    """
    for twin in evidence.twins("extra_calls"):
        calls = tuple(twin.change["calls"])
        parting = twin.divergence
        if kind not in calls or (parting is not None and len(calls) > 1):
            continue
        if kind == "sample" and parting is not None and _is_blamed(evidence, "spaces"):
            continue  # who samples asks for the space first
        if parting is None:
            yield Occasion(twin.base.at(None, None, kind), True)
        elif "next" in twin.change:
            yield Occasion(
                twin.base.at(twin.change["next"], None, kind), False,
                "the next reset goes on drawing as if nobody had called",
                f"after a reset without a seed {parting_words(parting)}",
                proof=_proof(evidence.api, kind, is_next=True),
            )  # fmt: skip
        else:
            yield Occasion(
                twin.base.at(crossings_of(parting), None, kind), False,
                "the play goes on as if nobody had called", parting_words(parting),
                proof=_proof(evidence.api, kind),
            )  # fmt: skip


def _is_blamed(evidence: Gathered, kind: str) -> bool:
    twins = evidence.twins("extra_calls")
    return any(list(t.change["calls"]) == [kind] and t.divergence is not None for t in twins)


def not_offered(kind: str) -> Callable[[Contract, Gathered], str | None]:
    """Says that there is no such call, where that was looked at."""

    def against(contract: Contract, evidence: Gathered) -> str | None:
        offered = [fact.value for fact in evidence.facts("extra_calls", "offered")]
        if offered and not any(kind in each for each in offered):
            return f"it answers no such call ({kind})"
        return None

    return against


def _proof(api: str, kind: str, *, is_next: bool = False) -> Proof:
    return story_proof(api, MEDDLING[kind], early=True, is_next=is_next)
