"""Checks of state that plays share: global generators, earlier episodes, other instances."""

from dataclasses import replace
from typing import Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.seed_facts import (
    EpisodeBefore,
    HashSeed,
    MovedGenerator,
    NumberedObjects,
    OtherInstance,
    RosterElsewhere,
    SettledElsewhere,
    UnmovedGenerator,
)
from gamekeeper.checks.literal import step_literal
from gamekeeper.checks.object_ids import ids_from
from gamekeeper.checks.paired_episodes import (
    difference_place,
    ignores_seeds,
    is_blind_later,
    parted,
    program,
    settled_by_seed,
    told_difference,
    told_of,
    used_beside_fresh,
    whole,
)
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import text_of
from gamekeeper.contract import Contract


@check("GK602", HIGH, "generators", applies=settled_by_seed)
def draws_come_from_an_own_generator(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The environment draws from its own generator, not from global ones (numpy, random, torch).

    Other code that draws from global generators, a learner or a second environment, changes the
    game, and reset's seed doesn't settle it. Tested by an episode in which they are seeded anew
    before the reset and between all turns, compared with one in which they aren't.

    Bad:
        def step(self, actions):
            wind = np.random.normal()

    Good:
        def reset(self, seed=None, options=None):
            if seed is not None or self.rng is None:
                self.rng = np.random.default_rng(seed)
        def step(self, actions):
            wind = self.rng.normal()

    Fix: draw from a generator of the environment's own, built in reset(seed):
    np.random.default_rng(seed)
    """
    lines = _moving_lines(evidence)
    for look in evidence.looks.get("generators", ()):
        facts = [fact.value for fact in look.facts]
        moved = [each.generator for each in facts if isinstance(each, MovedGenerator)]
        for counterfactual in look.counterfactuals:
            proof = _own_generator_proof(evidence.api, moved, told_of(contract, counterfactual))
            for case in parted(counterfactual, proof, expected=ALONE):
                yield replace(case, lines=() if case.ok else lines)


def _moving_lines(evidence: ProbeEvidence) -> tuple[str, ...]:
    """Lines that moved a global generator in any episode, each once."""
    used = [each for fact in evidence.facts(MovedGenerator) for each in fact.value.lines]
    return tuple(dict.fromkeys(used))


OTHER_SEEDS: Final = 20
"""Seeds of the global generators, or instances, that a reproducer tries."""


ALONE: Final = "the same episode, also when others draw from the global generators"


def _own_generator_proof(api: str, moved: list[str], tells: frozenset[str]) -> Reproducer:
    seeding = ["np.random.seed(n)", "random.seed(n)"]
    if "torch" in moved:
        seeding.append("torch.manual_seed(n)")
    head = ("def seed_all(n):", *(f"    {line}" for line in seeding))
    imports = "make()  # modules that it imports may draw"
    alone = (*head, imports, "seed_all(1)", "alone = play(make())")
    return program(
        api,
        *alone,
        f"for n in range({OTHER_SEEDS}):  # of few outcomes some are equal by chance",
        "    alike(alone, play(make(), between=lambda: seed_all(n)))",
        tells=tells,
        unchanged=(*alone, "seed_all(1)", "alike(alone, play(make()))"),
        imports=("random", *(["torch"] if "torch" in moved else [])),
    )


@check("GK603", MEDIUM, "generators")
def global_generators_are_left_alone(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The environment leaves the global generators of numpy, random and torch as they are.

    One that seeds them makes the exploration of a learner repeat itself with every episode, and
    results of a whole run hang on how often it was reset. Not looked at where the game's own draws
    come from them: that is GK602.

    Bad:
        def reset(self, seed=None, options=None):
            np.random.seed(seed)

    Good:
        def reset(self, seed=None, options=None):
            self.rng = np.random.default_rng(seed)

    Fix: leave np.random.seed, random.seed and torch.manual_seed to whoever runs the environment;
    build a generator of the environment's own
    """
    looks = evidence.looks.get("generators", ())
    parts = any(
        counterfactual.divergence is not None and counterfactual.noise is None
        for look in looks
        for counterfactual in look.counterfactuals
    )
    if parts and settled_by_seed(contract, evidence) is None:
        return  # an episode without a draw shows the seeding alone, and is of the same game
    for fact in (fact for look in looks for fact in look.facts):
        if isinstance(fact.value, UnmovedGenerator):
            yield Case(fact.where, True, "as it was", "as it was")
        elif isinstance(fact.value, MovedGenerator):
            name, call = fact.value.generator, fact.value.call
            seen = f"{name} was seeded or drawn from in {call}"
            proof = _global_generator_proof(evidence.api, name, plays=call != "make")
            yield Case(fact.where, False, "as it was", seen, proof, lines=fact.value.lines)


def _global_generator_proof(api: str, name: str, *, plays: bool) -> Reproducer:
    """Compares the next draw of a global generator, seeded alike, with and without an instance.

    Args:
        plays: the instance plays an episode.
    """
    seed, draw = {
        "numpy.random": ("np.random.seed(764_309)", "np.random.random()"),
        "random": ("random.seed(764_309)", "random.random()"),
        "torch": ("torch.manual_seed(764_309)", "torch.rand(1).item()"),
    }[name]
    episode = (
        "env.reset(seed=SEED)",
        "for action in ACTIONS:",
        *(["    env.last()"] if api == "aec" else []),
        "    env.step(action)",
    )
    lines = (
        seed,
        f"expected = {draw}",
        seed,
        "env = make()",
        *(episode if plays else ()),
        f"seen = {draw}",
        f'assert seen == expected, f"the next {draw} gives {{seen}}, not {{expected}}"',
    )
    imports = () if name == "numpy.random" else (name,)
    return Reproducer("\n".join(lines), plays=False, imports=imports, compares=True, unchanged="")


@check("GK604", HIGH, "second_episode", "unseeded", applies=settled_by_seed)
def nothing_survives_a_reset(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """reset(seed) starts the same episode in a used instance as in a fresh one.

    Training runs thousands of episodes in one instance; where something of the last one is left,
    no episode can be played again on its own. Tested after the same episode, and after one of
    another seed that is cut in its middle.

    Bad: what one step has noted stays for the next episode.

    ```python
    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)   # and self.collected is as it was
    ```

    Good:
        def reset(self, seed=None, options=None):
            self.rng = np.random.default_rng(seed)
            self.agents = list(self.possible_agents)
            self.collected = set()

    Fix: set everything that the rules read in reset(), the generator by its seed too, and take
    nothing over from the episode before
    """
    if ignores_seeds(evidence):
        return  # an episode hangs on what was drawn before, which is another promise
    for look in evidence.looks.get("second_episode", ()):
        if is_blind_later(look):
            continue  # later seeds are ignored, which is another promise
        fact = look.fact(EpisodeBefore)
        before = None if fact is None else fact.value.episode
        times = 1 if fact is None else fact.value.times
        for counterfactual in look.counterfactuals:
            told = told_of(contract, counterfactual)
            proof = used_beside_fresh(evidence.api, before, told, times=times)
            for seen in parted(
                counterfactual, proof, expected="the same episode as in a fresh instance"
            ):
                # where the episode itself went before, all of it takes part, wherever they differ
                yield replace(seen, where=whole(counterfactual)) if before is None else seen


@check("GK607", HIGH, "alternated", "other_process", applies=settled_by_seed)
def instances_share_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Instances of the environment share nothing: no generator and no state of a class or module.

    A vector environment steps many instances in turns, an evaluation runs beside the training; what
    one of them does then changes the others. A second instance is built, reset and stepped in
    turns with the first. Where an instance plays otherwise only because another one was there
    before, two new processes agree with each other.

    Bad:
        class Game(ParallelEnv):
            rng = np.random.default_rng()
            def reset(self, seed=None, options=None):
                Game.rng = np.random.default_rng(seed)

    Good:
        class Game(ParallelEnv):
            def reset(self, seed=None, options=None):
                self.rng = np.random.default_rng(seed)

    Fix: keep generators and state in the instance: set them in __init__ and reset, not on the
    class, the module or in a mutable default argument
    """
    for look in evidence.looks.get("alternated", ()):
        other = look.fact(OtherInstance)
        for counterfactual in look.counterfactuals:
            proof = _beside(
                evidence.api,
                None if other is None else other.value,
                told_of(contract, counterfactual),
            )
            yield from parted(counterfactual, proof, expected="the same episode as alone")
    for look in evidence.looks.get("other_process", ()):
        settled = look.fact(SettledElsewhere)
        if settled is not None and settled.value.is_settled:
            for counterfactual in look.counterfactuals:
                if counterfactual.noise is not None:
                    lines = (
                        "first = play(make())",
                        f"for count in range({OTHER_SEEDS}):  # others were there",
                        "    other = make()",
                        "    for _ in range(1 + count % 3):",
                        "        other.reset(seed=SEED)",
                        "    for actions in ACTIONS[: count % 4]:",
                        "        other.step(actions)",
                        "    alike(first, play(make()))",
                    )
                    where = difference_place(counterfactual, counterfactual.noise)
                    seen = told_difference(counterfactual.noise)
                    tells = told_of(contract, counterfactual)
                    proof = program(evidence.api, *lines, tells=tells, unchanged=())
                    yield Case(where, False, "the same episode as in a first instance", seen, proof)


def _beside(api: str, other: OtherInstance | None, tells: frozenset[str]) -> Reproducer:
    seed, actions = (0, ()) if other is None else (other.seed, other.actions)
    turns = ", ".join(step_literal(api, each) for each in actions)
    return program(
        api,
        "alone = play(make())",
        "env, other = make(), make()",
        "calls = [lambda: None]",
        f"calls += [lambda: other.reset(seed={seed})]",
        f"calls += [lambda actions=actions: other.step(actions) for actions in [{turns}]]",
        "calls = iter(calls)",
        "alike(alone, play(env, between=lambda: next(calls, lambda: None)()))",
        tells=tells,
        unchanged=(),  # what instances share makes the same episode twice differ just as well
    )


@check("GK608", HIGH, "other_process", applies=settled_by_seed)
def other_processes_play_the_same(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The same seed and actions give the same episode in other processes; no set's order decides.

    Python shuffles the order of sets of text anew in every process, so that results repeat within
    one run and never in the next. The other process runs under another PYTHONHASHSEED. Where the
    environment's own modules ask for id(), an address in memory, they are given other numbers once.

    Bad: `agents` in the order of a set.

    ```python
    self.agents = list({*self.hunters, *self.prey})
    ```

    Good:
        self.agents = [*self.hunters, *self.prey]

    Fix: sort a set before its order matters (agents, items, draws), and derive nothing from hash(),
    id(), the process's number or the clock
    """
    for look in evidence.looks.get("other_process", ()):
        fact = look.fact(HashSeed)
        seed = None if fact is None else fact.value.seed
        for counterfactual in look.counterfactuals:
            proof = _process_proof(evidence.api, seed, told_of(contract, counterfactual))
            yield from parted(counterfactual, proof, expected="the same episode as in this process")
    for numbered in evidence.facts(NumberedObjects):
        is_ok = numbered.value.turn is None
        expected = "the same episode, wherever objects lie in memory"
        proof = _ids_proof(evidence.api, numbered.value.start)
        yield Case(numbered.where, is_ok, expected, "another one with other results of id()", proof)
    for order in evidence.facts(RosterElsewhere):
        here, there = order.value.here, order.value.there
        yield Case(
            order.where,
            here == there,
            "`agents` in the same order as in this process",
            f"{', '.join(there)} there, {', '.join(here)} here",
            _process_proof(evidence.api, order.value.hash_seed, frozenset(), shows=ROSTERS),
        )


ROSTERS: Final = """\
def rosters(env):
    env.reset(seed=SEED)
    seen = [list(env.agents)]
    for action in ACTIONS:
        env.step(action)
        seen.append(list(env.agents))
    return seen
play = rosters"""
"""Lines that look at nothing of a play but the order of `agents`."""


def _ids_proof(api: str, start: int) -> Reproducer:
    """Two episodes in which the environment's modules get other numbers for objects."""
    lines = (
        *text_of(ids_from)[0].splitlines(),
        "def numbered(start):",
        "    ids_from(make(), start)",
        "    return play(make())",
    )
    return program(
        api,
        *lines,
        f"alike(numbered(0), numbered({start}))",
        imports=("sys",),
        unchanged=(*lines, "alike(numbered(0), numbered(0))"),
    )


def _process_proof(
    api: str, seed: int | None, tells: frozenset[str], *, shows: str = ""
) -> Reproducer:
    """Starts itself again under hash seeds, each of which prints its play, until one differs."""
    return program(
        api,
        *shows.splitlines(),
        'if "HASHED" in os.environ:',
        '    print(*map(repr, play(make())), sep="\\n")',
        "    sys.exit()",
        "def played(hash_seed):",
        '    surroundings = {**os.environ, "HASHED": "1", "PYTHONHASHSEED": str(hash_seed)}',
        "    again = [sys.executable, *sys.orig_argv[1:]]",
        "    done = subprocess.run(again, env=surroundings, capture_output=True)",
        "    return done.stdout.splitlines()",
        "first = played(0)",
        f"for hash_seed in ({seed}, 11, 12, 13, 14, 15):",
        "    alike(first, played(hash_seed))",
        tells=tells,
        imports=("os", "subprocess", "sys"),
    )
