"""Cases about one episode that was played twice, and programs that play it twice."""

from typing import Any, Final

import numpy as np

from gamekeeper.checks.case import Case, Cases, Reproducer
from gamekeeper.checks.facts.seed_facts import (
    EpisodeElsewhere,
    LaterSeeds,
    SeededEpisodes,
    UnseededEpisodes,
    UnseededOpenings,
)
from gamekeeper.checks.literal import literal, step_literal
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeEvidence, ProbeRun
from gamekeeper.checks.reproducer_source import text_of
from gamekeeper.checks.reproducers import alike
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import shown
from gamekeeper.episodes.divergence import Divergence, shown_pair
from gamekeeper.episodes.where import PAID_BY, Where

FIELD: Final = "rerun"
"""Names the place where two episodes part, whatever it is in that differs."""
SAME: Final = "the same episode"

MOST_SHOWN: Final = 80
"""Characters of an array or a dictionary."""

_PAID: Final = PAID_BY | {"reward", "action"}


def settled_by_seed(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why there is no case where a seed needn't settle the episode."""
    if contract.seeds.deterministic is False:
        return "the contract declares that a seed doesn't settle the episode"
    return None


def parted(
    counterfactual: ProbeCounterfactual, proof: Reproducer, *, expected: str = SAME
) -> Cases:
    """One look at a counterfactual: did it part from its base, and from nothing else's doing?"""
    divergence = counterfactual.divergence
    if divergence is not None and divergence.field == "nonconforming":
        return  # equal values, one of which came before its space could be asked for
    if divergence is None:
        yield Case(whole(counterfactual), True, expected, expected)
    elif counterfactual.noise is None:
        seen = told_difference(divergence)
        yield Case(difference_place(counterfactual, divergence), False, expected, seen, proof)


def whole(counterfactual: ProbeCounterfactual) -> Where:
    """The episode of a counterfactual as a whole."""
    return counterfactual.base.at(None, None, FIELD)


def difference_place(counterfactual: ProbeCounterfactual, divergence: Divergence) -> Where:
    """The place of a divergence, its turn counted by the steps that it takes to see it."""
    turn = divergence.turn
    if turn is not None:
        turn += divergence.field.partition(".")[0] in _PAID
    return counterfactual.base.at(turn, divergence.agent, FIELD)


def told_difference(divergence: Divergence) -> str:
    """Both values in one line."""
    key = divergence.field if divergence.field != "rows" else "the list of agents with a row"
    if divergence.agent is not None:
        key += f"[{divergence.agent!r}]"
    turn = "" if divergence.turn is None else f" at turn {divergence.turn}"
    one, two, at = _unlike(divergence.recorded, divergence.replayed)
    return f"{key}{at}{turn} is {two}, not {one}"


def _unlike(one: Any, two: Any) -> tuple[str, str, str]:
    """Both values in words; of several the first that differs, with its place."""
    are_rows = type(one) is type(two) and type(one) in (list, tuple) and len(one) == len(two)
    items = [dict(enumerate(each)) for each in (one, two)] if are_rows else [one, two]
    if all(isinstance(each, dict) for each in items):
        for key in {**items[0], **items[1]}:
            pair = items[0].get(key), items[1].get(key)
            if literal(pair[0]) != literal(pair[1]):
                shown_one, shown_two, inside = _unlike(*pair)
                return shown_one, shown_two, f"[{key!r}]{inside}"
    both = isinstance(one, np.ndarray) and isinstance(two, np.ndarray)
    if both and one.shape == two.shape and one.ndim:
        places = np.argwhere(~((one == two) | ((one != one) & (two != two))))
        if len(places):
            at = tuple(places[0].tolist())
            return literal(one[at]), literal(two[at]), str(list(at))
    shown = shown_pair(one, two)
    return _brief(one, shown[0]), _brief(two, shown[1]), ""


def _brief(value: Any, shown: str) -> str:
    if value is None:
        return "missing"
    return literal(value)[:MOST_SHOWN] if isinstance(value, np.ndarray | dict) else shown


def told_of(
    contract: Contract, counterfactual: ProbeCounterfactual | None = None
) -> frozenset[str]:
    """Parts of an episode that a reproducer compares beside observations: `infos`, `state`."""
    infos = set() if contract.volatile_infos() else {"infos"}
    has_state = counterfactual is not None and counterfactual.base.states is not None
    return frozenset(infos | ({"state"} if has_state else set()))


TWICE: Final = ("alike(play(make()), play(make()))",)
"""Lines that compare an episode with the same one again."""


def program(
    api: str,
    *lines: str,
    tells: frozenset[str] = frozenset({"infos"}),
    imports: tuple[str, ...] = (),
    reset: str = "env.reset(seed=seed)",
    unchanged: tuple[str, ...] = TWICE,
) -> Reproducer:
    """A program whose `play(env, seed=SEED)` gives what was seen, as text by turn.

    Where the lines hand it a `between`, that is called before the reset and each step. Its
    `alike(one, other)` raises at the first turn in which two episodes differ. An error of the
    environment is seen like all else, and ends the episode.

    Args:
        lines: what is done with it.
        tells: `infos` (not where some of them may differ), `state`.
        imports: modules that the lines need.
        reset: how each episode begins; without an argument it is another one than with None.
        unchanged: the lines without what makes the episodes differ; empty where nothing does but
            the environment itself.
    """
    body = _parallel(reset, tells) if api == "parallel" else _aec(reset, tells)
    is_disturbed = any("between=" in line for line in lines)
    body = body if is_disturbed else [line for line in body if line.strip() != "between()"]
    told = [
        'np.set_printoptions(threshold=10**9, floatmode="unique")',
        f"def play(env, seed=SEED{', between=lambda: None' if is_disturbed else ''}):",
        "    seen = []",
        "    try:",
        *(f"    {line}" for line in body),
        "    except Exception as error:",
        "        seen.append(error)",
        "    # an object's address differs from play to play",
        "    return tuple(re.sub(' at 0x[0-9a-f]+', '', repr(each)) for each in seen)",
        "",
        *text_of(alike)[0].splitlines(),
        "",
    ]
    return Reproducer(
        "\n".join([*told, *lines]),
        plays=False,
        imports=("re", *imports),
        compares=True,
        unchanged="\n".join([*told, *unchanged]) if unchanged else "",
    )


def _parallel(reset: str, tells: frozenset[str]) -> list[str]:
    cuts = ("", "") if "infos" in tells else ("[:1]", "[:4]")
    state = "env.state()" if "state" in tells else ""
    return [
        "    between()",
        f"    seen.append({_both(reset + cuts[0], state)})",
        "    for actions in ACTIONS:",
        "        between()",
        f"        seen.append({_both('env.step(actions)' + cuts[1], state)})",
    ]


def _both(given: str, state: str) -> str:
    return f"({given}, {state})" if state else given


def _aec(reset: str, tells: frozenset[str]) -> list[str]:
    last = "env.last()" if "infos" in tells else "env.last()[:4]"
    rewards = 'dict(getattr(env, "rewards", {}))'  # a reset may leave them to the first step
    look = f"env.agents and (env.agent_selection, {last}), {rewards}"
    if "state" in tells:
        look += ", env.state()"
    return [
        "    between()",
        f"    {reset}",
        f"    seen.append(({look}))",
        "    for action in ACTIONS:",
        "        between()",
        "        env.step(action)",
        f"        seen.append(({look}))",
    ]


def ignores_seeds(evidence: ProbeEvidence) -> bool:
    """Tells whether all seeds gave one episode, and resets without a seed several openings."""
    for look in evidence.looks.get("unseeded", ()):
        seeded, openings = look.fact(SeededEpisodes), look.fact(UnseededOpenings)
        if seeded is None or openings is None:
            continue
        if len(set(seeded.value.digests)) == 1 and len(set(openings.value.openings)) > 1:
            return True
    return False


def differs_by_itself(evidence: ProbeEvidence) -> bool:
    """Tells whether the same seed and actions gave another episode, with nothing changed."""
    again = evidence.counterfactuals("same_seed")
    return any(x.change["change"] == "nothing" and x.divergence is not None for x in again)


def draws_nothing(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why there is no case where episodes never differ, with or without a seed."""
    against = settled_by_seed(contract, evidence)
    if against is not None:
        return against
    if any(fact.value.difference for fact in evidence.facts(EpisodeElsewhere)):
        return None
    seeded = [fact.value.digests for fact in evidence.facts(SeededEpisodes)]
    unseeded = [fact.value.digests for fact in evidence.facts(UnseededEpisodes)]
    if seeded and not evidence.blind and all(len(set(each)) == 1 for each in (*seeded, *unseeded)):
        return "no seed and no reset without one led to another episode: nothing was drawn"
    return None


def is_blind_later(look: ProbeRun) -> bool:
    """Tells whether seeds make a difference in a fresh instance, and none in a used one."""
    seeds = look.fact(LaterSeeds)
    return seeds is not None and seeds.value.in_fresh and not seeds.value.in_used


def used_beside_fresh(
    api: str, before: Any, tells: frozenset[str], *, times: int = 1
) -> Reproducer:
    """Plays in a used instance and in a fresh one.

    Args:
        before: seed and actions of the episode that goes before; None: of the episode itself.
        times: how often it goes before; more than once only the episode itself, or one without
            actions.
    """
    often = ["play(used)"] if times == 1 else [f"for _ in range({times}):", "    play(used)"]
    used = ["used = make()", *often]
    if before is not None and times > 1:
        reset = f"    used.reset(seed={before[0]!r})"
        used = ["used = make()", f"for _ in range({times}):", reset]
    elif before is not None:
        seed, actions = before
        used = [
            "used = make()",
            f"used.reset(seed={seed!r})",
            "for actions in [",
            *(f"    {step_literal(api, turn)}," for turn in actions),
            "]:",
            "    used.step(actions)",
            *(["    used.state()"] if "state" in tells else []),
        ]
    return program(api, *used, "alike(play(used), play(make()))", tells=tells)


COUNTERFACTUAL_FIELDS: Final = {"reward": "rewards", "action": "actions", "obs": "observations"}


def counterfactual_cases(
    counterfactual: ProbeCounterfactual, expected: str, proof: Reproducer | None = None
) -> Cases:
    """Compares a counterfactual with its base; yields nothing where the unchanged rerun diverges.

    An episode that isn't the same twice may part from itself earlier or later each time, so that a
    unchanged rerun which happens to part later than the counterfactual accuses nobody.
    """
    found = counterfactual.divergence
    if counterfactual.noise is not None:
        return
    if found is None:
        yield Case(counterfactual.base.at(None), True, expected, "the same", proof=proof)
        return
    name, _, _ = found.field.partition(".")
    where = counterfactual.base.at(found.turn, found.agent, COUNTERFACTUAL_FIELDS.get(name, name))
    recorded, replayed = shown(found.recorded), shown(found.replayed)
    if "\n" in recorded + replayed:  # large arrays: the first element that differs
        recorded, replayed = shown_pair(found.recorded, found.replayed)
    yield Case(where, False, f"{expected}: {recorded}", replayed, proof=proof)
