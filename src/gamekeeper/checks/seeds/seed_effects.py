"""Checks of seeds: they settle an episode, differ, and hold for later episodes."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, Case, Cases, check
from gamekeeper.checks.facts.seed_facts import (
    AskedEntropy,
    EpisodeBefore,
    EpisodeElsewhere,
    PlainSeed,
    SeededEpisodes,
    SettledElsewhere,
    SpecialRefused,
    UnseededAgain,
    UnseededEpisodes,
    UnseededOpenings,
)
from gamekeeper.checks.literal import literal
from gamekeeper.checks.paired_episodes import (
    FIELD,
    SAME,
    difference_place,
    differs_by_itself,
    draws_nothing,
    is_blind_later,
    parted,
    program,
    settled_by_seed,
    told_difference,
    told_of,
    whole,
)
from gamekeeper.checks.probe_evidence import ProbeCounterfactual, ProbeEvidence
from gamekeeper.contract import Contract
from gamekeeper.episodes.divergence import compare
from gamekeeper.episodes.episode import MASK

SEEDS: Final = 16
"""Seeds that the program tries."""


@check("GK600", HIGH, "unseeded", applies=draws_nothing)
def seeds_make_a_difference(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Different seeds give different episodes where anything is drawn; the seed isn't ignored.

    Training on a thousand seeds is else training on one, and a test on other seeds tests nothing. A
    game without any randomness passes: judged only where there is chance, seen in one of two ways.
    Resets without a seed lead to different openings, while 16 seeds give equal plays: where seeds
    are obeyed that needs one opening of a probability near 1, and happens in fewer than one of
    1,000 environments. Or resets without a seed give that same episode too, and yet it goes another
    way where a generator that the environment holds is moved elsewhere in its stream after the
    reset, one that every reset begins at the same place. What is drawn in the reset alone, from a
    constant, is a layout like any other.

    Bad: a generator from the constructor, whatever the seed.

    ```python
    def __init__(self):
        self.rng = np.random.default_rng(42)
    def reset(self, seed=None, options=None):
        self.board = self.rng.permutation(9)
    ```

    Good:
        def reset(self, seed=None, options=None):
            if seed is not None or self.rng is None:
                self.rng = np.random.default_rng(seed)
            self.board = self.rng.permutation(9)

    Fix: build the generator from `seed` in reset(), and draw from nothing else
    """
    for look in evidence.looks.get("unseeded", ()):
        plays = look.fact(SeededEpisodes)
        first = look.fact(UnseededOpenings)
        other = look.fact(EpisodeElsewhere)
        if plays is None:
            continue
        seeded = plays.value.digests
        openings = () if first is None else first.value.openings
        if len(set(seeded)) > 1:
            yield Case(plays.where, True, "plays that differ", "plays that differ")
        elif len(set(openings)) > 1:
            expected = "plays that differ, as unseeded ones do"
            seen = f"{len(seeded)} seeds, and all of them give the same episode"
            yield Case(plays.where, False, expected, seen, _differing_seeds_proof(evidence.api))
        elif other is not None and other.value.difference is not None:
            yield Case(
                other.where,
                False,
                "plays that differ, as the game draws at random",
                f"all seeds and no seed give the same episode; with other draws "
                f"{other.value.difference}",
                _differing_seeds_proof(evidence.api),
            )


def _differing_seeds_proof(api: str) -> Reproducer:
    lines = (
        f"seen = {{play(make(), seed) for seed in range({SEEDS})}}",
        f'assert len(seen) > 1, f"{SEEDS} seeds, and after each of them {{str(seen)[:400]}}"',
    )
    return program(api, *lines, unchanged=())


AGAIN: Final = 70
"""Plays that the program compares, up to the first that differs."""
MISSED: Final = (
    f"# {AGAIN} plays: where 1 of 10 differs, all are equal by chance in {0.9**AGAIN:.2%} of runs"
)


@check("GK601", HIGH, "same_seed", "other_process", "options", applies=settled_by_seed)
def seed_settles_the_play(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Deterministic by the seed: after reset(seed) the same actions give the same episode.

    Otherwise the seed is ignored, or part of the randomness isn't seeded, and no result can be
    reproduced. Observations, masks, infos, rewards, ends, the order of agents and state() are
    compared, over whole episodes, also under an option of the reset; once more with the generators
    of numpy, random and torch that all of a process shares started elsewhere, as in another
    program. Empty options make no difference either, nor does the time of day. Where infos alone
    differ it is of low severity: a clock among them is declared volatile in a contract.

    Bad:
        def step(self, actions):
            wind = np.random.default_rng().normal()

    Good:
        def step(self, actions):
            wind = self.rng.normal()

    Fix: draw everything from one generator that reset(seed) builds from the seed: nothing from the
    clock, the system's entropy, generators of the whole process or spaces that nobody seeded; and
    set everything that an episode changes in reset(), what the constructor changed too
    """
    if any(fact.value.is_settled for fact in evidence.facts(SettledElsewhere)):
        return  # instances share something, and that is another promise
    plays = list(evidence.counterfactuals("same_seed"))
    differs = differs_by_itself(evidence)
    if not differs:
        optional = evidence.counterfactuals("options")
        plays += [each for each in optional if each.change["change"] == "the same option"]
    facts = evidence.facts(AskedEntropy)
    lines = tuple(dict.fromkeys(line for fact in facts for line in fact.value.lines))
    for each in plays:
        change, tells = each.change["change"], told_of(contract, each)
        if change in ("nothing", "the global generators", "the same option"):
            asked = lines if change == "nothing" else ()
            for case in parted(each, _again(evidence.api, tells, each.change)):
                is_minor = not case.ok and _is_of_infos(each)
                if is_minor:
                    case = replace(case, severity=LOW, fix=VOLATILE)
                yield case if case.ok else replace(case, lines=asked)
        elif differs:
            continue  # by itself, whatever the clock says
        elif change == "the time of day":
            proof = _later(evidence.api, each.change["later_s"], tells)
            yield from parted(each, proof, expected="the same episode, whatever the clock says")
        elif not any(x.divergence for x in plays if x is not each):
            yield from parted(each, _empty(evidence.api), expected="as without options")


VOLATILE: Final = (
    "declare an info that only measures, such as a clock, in a contract, so that the rest can be "
    "judged: [infos] NAME = { volatile = true }; any other: draw it from a generator that "
    "reset(seed) builds"
)
"""Fix of infos that alone differ."""


def _is_of_infos(counterfactual: ProbeCounterfactual) -> bool:
    """Tells whether two plays differ in infos alone, in anything of them but action masks."""
    plays = counterfactual.base, counterfactual.episode
    infos = (info for play in plays for turn in play.turns for info in turn.infos.values())
    names = {name for info in infos if isinstance(info, dict) for name in info} - {MASK}
    return compare(*plays, volatile={*names, *counterfactual.volatile}).divergence is None


def _again(api: str, tells: frozenset[str], change: Mapping[str, Any]) -> Reproducer:
    lines, options = _repeated("play(make())"), ""
    if "option" in change:
        options = f", options={{{literal(change['option'])}: {literal(change['value'])}}}"
    reset = f"env.reset(seed=seed{options})"
    return program(api, *lines, tells=tells, reset=reset, unchanged=())


def _repeated(play: str) -> tuple[str, ...]:
    """Lines that compare an episode with itself, played again and again."""
    return (f"first = {play}", MISSED, f"for _ in range({AGAIN}):", f"    alike(first, {play})")


def _later(api: str, seconds: int, tells: frozenset[str]) -> Reproducer:
    lines = (
        "first, now = play(make()), time.time",
        f"time.time = lambda: now() + {seconds}  # as if it were run again later",
        f"time.time_ns = lambda: int(now() + {seconds}) * 10**9",
        "alike(play(make()), first)",
    )
    return program(api, *lines, tells=tells, imports=("time",))


def _empty(api: str) -> Reproducer:
    see = "seen" if api == "parallel" else "env.last()"
    lines = ["def first(**options):", "    env = make()"]
    lines.append("    seen = env.reset(seed=SEED, **options)")
    lines += [f"    return repr({see})", "plain, empty = first(), first(options={})"]
    lines += ["assert plain == empty, (plain, empty)"]
    return Reproducer("\n".join(lines), plays=False)


@check("GK605", HIGH, "special_seeds", applies=settled_by_seed)
def seed_zero_is_a_seed(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Seed 0 is a seed like any other, and so is 2**31 - 1.

    0 is the seed that most people try first; where it is taken for no seed, exactly their runs
    don't repeat. Looked at beside a plain seed, which goes well.

    Bad:
        def reset(self, seed=None, options=None):
            if seed:
                self.rng = np.random.default_rng(seed)

    Good:
        def reset(self, seed=None, options=None):
            if seed is not None:
                self.rng = np.random.default_rng(seed)

    Fix: ask `if seed is not None`, never `if seed`, and take any non-negative integer
    """
    for look in evidence.looks.get("special_seeds", ()):
        plain, refused = look.fact(PlainSeed), look.fact(SpecialRefused)
        for counterfactual in look.counterfactuals:
            seed = counterfactual.change["seed"]
            is_used = bool(counterfactual.change["is_used"])
            tells = told_of(contract, counterfactual)
            proof = _seed_zero_proof(evidence.api, seed, tells, is_used=is_used)
            if plain is None:
                yield Case(whole(counterfactual), True, SAME, SAME)
            elif plain.value.is_fine and refused is not None:
                at = counterfactual.base.at(0, None, FIELD)
                refusal = Reproducer(f"make().reset(seed={seed})", plays=False)
                yield Case(at, False, "a seed like any other", refused.value.text, refusal)
            elif plain.value.is_fine:
                yield from parted(
                    counterfactual, proof, expected=f"the same episode for seed {seed} again"
                )


PLAIN_SEED: Final = 12345


def _seed_zero_proof(api: str, seed: int, tells: frozenset[str], *, is_used: bool) -> Reproducer:
    env, begin = ("env", ("env = make()",)) if is_used else ("make()", ())
    plain = f"play({env}, seed={PLAIN_SEED})"
    unchanged = (*begin, f"alike({plain}, {plain})")
    lines = *begin, *_repeated(f"play({env}, seed={seed})")
    return program(api, *lines, tells=tells, unchanged=unchanged)


@check(
    "GK606",
    HIGH,
    "second_episode",
    applies=settled_by_seed,
    looks_at="a used instance that repeats a fresh one's episode of a seed, or the same one for "
    "all (any other difference is GK604's)",
)
def later_seeds_are_obeyed(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every reset(seed) seeds its episode, not only the first one of an instance.

    Where later seeds are ignored, an evaluation on fixed seeds in one instance isn't one: its
    episodes depend on what was played before. In a used instance several seeds give one and the
    same episode, while in fresh instances they give different ones.

    Bad:
        def reset(self, seed=None, options=None):
            if self.rng is None:
                self.rng = np.random.default_rng(seed)

    Good:
        def reset(self, seed=None, options=None):
            if self.rng is None or seed is not None:
                self.rng = np.random.default_rng(seed)

    Fix: build the generator anew whenever reset() is given a seed, not only where there is none yet
    """
    for look in evidence.looks.get("second_episode", ()):
        for counterfactual in look.counterfactuals:
            if counterfactual.divergence is None:
                yield Case(whole(counterfactual), True, "seeds are obeyed", "seeds are obeyed")
            elif counterfactual.noise is None and is_blind_later(look):
                where = difference_place(counterfactual, counterfactual.divergence)
                expected = "the episode of this seed"
                seen = "the same episode for any seed: "
                seen += told_difference(counterfactual.divergence)
                before = look.fact(EpisodeBefore)
                times = 1 if before is None else before.value.times
                yield Case(where, False, expected, seen, _later_seeds_proof(evidence.api, times))


def _later_seeds_proof(api: str, times: int) -> Reproducer:
    before = (
        ["    play(env)"] if times == 1 else [f"    for _ in range({times}):", "        play(env)"]
    )
    return program(
        api,
        "def later(seed):",
        "    env = make()",
        *before,
        "    return play(env, seed)",
        f"seen = {{later(seed) for seed in range({SEEDS})}}",
        f'assert len(seen) > 1, f"{SEEDS} seeds, and after each of them {{str(seen)[:400]}}"',
    )


FALSE_ALARM: Final = 1e-3
RESETS: Final = 16
"""Resets that the program tries."""


@check("GK609", HIGH, "unseeded", applies=draws_nothing)
def unseeded_resets_draw_anew(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A reset without a seed goes on drawing; it re-seeds with no constant, last seed or entropy.

    Training resets without a seed, and would see one and the same episode again and again. Judged
    only where seeds make a difference. Fisher's exact test on how often plays of 16 resets without
    a seed and of 16 seeds are the most frequent one, one-sided, once per audit: in fewer than one
    of 1,000 environments that are right is this broken. Of low severity is a reset without a seed
    that begins with the system's entropy: seeding once, before a training, settles none of it then.
    Seen where two instances that were seeded alike, and played alike, part at the next reset.

    Bad:
        def reset(self, seed=None, options=None):
            self.rng = np.random.default_rng(0 if seed is None else seed)

    Good:
        def __init__(self):
            self.rng = np.random.default_rng()
        def reset(self, seed=None, options=None):
            if seed is not None:
                self.rng = np.random.default_rng(seed)

    Fix: let reset() without a seed go on with the generator that is there; build one only where a
    seed is given or none was built yet
    """
    for look in evidence.looks.get("unseeded", ()):
        plays, others = look.fact(SeededEpisodes), look.fact(UnseededEpisodes)
        on = look.fact(UnseededAgain)
        if on is not None:
            expected = "the same episode in two instances that were seeded and played alike"
            proof = _entropy_proof(evidence.api)
            yield Case(on.where, on.value.is_same, expected, "another one", proof, severity=LOW)
        if plays is None or others is None:
            continue
        seeded, unseeded, at = plays.value.digests, others.value.digests, others.where
        if len(set(unseeded)) > 1:
            yield Case(at, True, "plays that differ", "plays that differ")
        elif len(set(seeded)) > 1:
            p = p_all_alike(seeded, len(unseeded))
            if p < FALSE_ALARM:
                expected = "plays that differ, as those of seeds do"
                seen = f"{len(unseeded)} resets without a seed, and the same episode after each"
                yield Case(
                    at, False, expected, seen, _unseeded_proof(evidence.api), confidence=1.0 - p
                )


def _entropy_proof(api: str) -> Reproducer:
    return program(
        api,
        "seen = []",
        "for env in (make(), make()):",
        "    env.reset(seed=SEED)",
        "    seen.append(play(env))  # which begins with a reset without a seed",
        "alike(*seen)",
        reset="env.reset()",
        unchanged=(),
    )


def p_all_alike(seeded: Sequence[str], count: int) -> float:
    """Probability that `count` further plays are all the most frequent of the seeded ones.

    Source: Fisher's exact test, one-sided, for a table with one empty cell.
    """
    often = max(Counter(seeded).values())
    return math.comb(often + count, count) / math.comb(len(seeded) + count, count)


def _unseeded_proof(api: str) -> Reproducer:
    return program(
        api,
        "env = make()",
        "env.reset(seed=SEED)",
        f"seen = {{play(env) for _ in range({RESETS})}}",
        f'assert len(seen) > 1, f"{RESETS} unseeded resets, and after each {{str(seen)[:400]}}"',
        reset="env.reset()",
        unchanged=(),
    )
