"""Checks of the spaces that an environment declares."""

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.space_facts import AskedSpace, ChangedSpace, SpaceEntry, SpaceFaults
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract


@check("GK201", HIGH, "spaces")
def spaces_exist_before_reset(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every possible agent has its spaces at any time, already before the first reset.

    Trainers build networks and buffers from the observation and action spaces before they reset
    anything, and ask for them also when an agent has left.

    Bad:
        def reset(self, seed=None, options=None):
            self._spaces = {a: Discrete(5) for a in self.possible_agents}

    Good:
        def __init__(self):
            self._spaces = {a: Discrete(5) for a in self.possible_agents}

    Fix: make the spaces of all possible agents in __init__, and let the methods
    observation_space(agent) and action_space(agent) return them
    """
    for fact in evidence.facts(AskedSpace):
        value, agent = fact.value, fact.where.agent
        seen = f"{value.failed or 'a ' + value.type}, {value.when}"
        proof = _early_spaces_proof(str(agent), str(value.which), str(value.when))
        yield Case(fact.where, value.space is not None, "a Gymnasium space", seen, proof)


def _early_spaces_proof(agent: str, which: str, when: str) -> Reproducer:
    roster = "env.agents" if when == "live" else "env.possible_agents"
    lines = (
        f"agent = next(a for a in {roster} if str(a) == {agent!r})\n"
        f"space = env.{which}_space(agent)\n"
        "assert isinstance(space, gymnasium.spaces.Space), space"
    )
    if when == "before reset":
        return Reproducer(f"env = make()\n{lines}", plays=False, imports=("gymnasium",))
    again = "env.reset(seed=None if SEED is None else SEED + 1)\n"
    return Reproducer(
        (again if when == "after another reset" else "") + lines, imports=("gymnasium",)
    )


@check("GK202", MEDIUM, "spaces")
def spaces_are_one_object(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent's space is the very same object at every call, not a new one.

    A seed that is given to a space which is thrown away has no effect: sampled actions differ in
    every run, and each call costs what making a space costs. PettingZoo's own API test asks for it.

    Bad:
        def action_space(self, agent): return Discrete(5)

    Good:
        @functools.cache
        def action_space(self, agent): return Discrete(5)

    Fix: make each space once and return that object: from a dictionary, or with functools.cache
    """
    for fact in evidence.facts(AskedSpace):
        if fact.value.space is None:
            continue
        name, agent = fact.where.field, str(fact.where.agent)
        is_ok = bool(fact.value.is_same)
        roster = "env.agents" if fact.value.when == "live" else "env.possible_agents"
        find = f"agent = next(a for a in {roster} if str(a) == {agent!r})"
        proof = f"{find}\nassert env.{name}(agent) is env.{name}(agent), agent"
        yield Case(fact.where, is_ok, "the same object twice", "two objects", proof)


@check("GK203", HIGH, "spaces")
def spaces_stay_the_same(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent's spaces never change: not by a reset, not in an episode, not in the next one.

    Networks are built for the spaces once. What is drawn from a space that has changed since is
    outside of what the environment, or the network, now takes.

    Bad:
        def reset(self, seed=None, options=None):
            self.action_spaces[agent] = Discrete(self.rng.integers(3, 6))

    Good:
        Discrete(5), and an action mask for the actions that aren't there this time

    Fix: declare the largest space that any episode needs, and mask or pad what isn't used
    """
    for fact in evidence.facts(ChangedSpace):
        value, agent, name = fact.value, str(fact.where.agent), fact.where.field
        proof = _space_change_proof(agent, name, is_later=value.when == "after another reset")
        yield Case(fact.where, bool(value.is_same), value.was, value.now, proof)


def _space_change_proof(agent: str, name: str, *, is_later: bool) -> Reproducer:
    """The space before the episode, copied, against the one after it, or after the next reset."""
    again = "env.reset(seed=None if SEED is None else SEED + 1)\n" if is_later else ""
    find = f"next(a for a in env.possible_agents if str(a) == {agent!r})"
    return Reproducer(
        f"{again}agent = {find}\n"
        "fresh = make()\n"
        "try:\n"
        f"    before = fresh.{name}(agent)\n"
        "except Exception:  # spaces that exist only after a reset\n"
        "    fresh.reset(seed=SEED)\n"
        f"    before = fresh.{name}(agent)\n"
        f"assert env.{name}(agent) == copy.deepcopy(before), (before, env.{name}(agent))",
        imports=("copy",),
    )


@check("GK204", HIGH, "spaces")
def spaces_are_sound(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every space can hold a value: low isn't above high, no bound is NaN, sample() gives a member.

    Nothing is in a space whose bounds are the wrong way round; normalising by it flips signs or
    divides by nothing.

    Bad:
        space.low, space.high = space.high, space.low

    Good:
        spaces.Box(low=-1.0, high=1.0, shape=(2,), dtype=np.float32)

    Fix: give bounds with low <= high, at least one value, and a sample() that is in the space
    """
    for fact in evidence.facts(SpaceFaults):
        found, name, agent = fact.value.faults, fact.where.field, str(fact.where.agent)
        proof = f"""\
agent = next(a for a in env.possible_agents if str(a) == {agent!r})
space = env.{name}(agent)
try:
    is_sound = space.contains(space.sample())
except Exception:  # NumPy refuses such bounds
    is_sound = False
assert is_sound, space"""
        yield Case(fact.where, not found, "a space that holds values", "; ".join(found), proof)


@check("GK205", LOW, "spaces", looks_at="an attribute `observation_spaces` or `action_spaces`")
def space_dictionaries_agree(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`observation_spaces` and `action_spaces` hold the spaces that the methods return.

    Older readers take a space from the dictionary, newer ones from the method.

    Bad:
        self.action_spaces = {a: Discrete(4) for a in self.possible_agents}
        def action_space(self, agent): return self._spaces[agent]          # Discrete(5)

    Good:
        def action_space(self, agent): return self.action_spaces[agent]

    Fix: let the method return what the dictionary holds, or drop the dictionary
    """
    for fact in evidence.facts(SpaceEntry):
        value, name = fact.value, fact.where.field
        proof = (
            f"for agent, space in env.{name}.items():\n"
            f"    assert space == env.{name.removesuffix('s')}(agent), (agent, space)"
        )
        expected = f"{value.method}, as the method says"
        yield Case(fact.where, bool(value.is_same), expected, value.dictionary, proof)
