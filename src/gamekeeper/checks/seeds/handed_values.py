"""Checks of values handed out or over: they stay, are copies, and agents have their own."""

from collections.abc import Callable, Iterator
from typing import TypeVar

from gamekeeper.checks.case import Case, Cases, Reproducer
from gamekeeper.checks.check import HIGH, LOW, MEDIUM, check
from gamekeeper.checks.compared_reproducer import env_steps_of, first_divergence_words
from gamekeeper.checks.facts.handed_facts import (
    HandedActions,
    HandedOptions,
    KeptValues,
    SharedValues,
    WrittenValues,
)
from gamekeeper.checks.literal import key_literal
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import actions_are_read_at_once, actions_stay
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import shown

T = TypeVar("T")
GOES_ON = "the episode goes on as if nothing was written"
PLACES = {"observations": 0, "rewards": 1, "terminations": 2, "truncations": 3, "infos": -1}
"""Place of each part in the tuple that a Parallel environment's step returns."""


def kept_cases(evidence: ProbeEvidence, *fields: str) -> Cases:
    """Yields a case for every look at things of these kinds that were handed out earlier."""
    for fact in evidence.facts(KeptValues):
        if fact.where.field not in fields:
            continue
        changed = fact.value.changed
        fine = fact.value.looks - (changed is not None)
        for _ in range(fine):
            yield Case(fact.where, True)
        if changed is not None:
            expected = f"what was handed out at turn {changed.given} stays as it is"
            proof = _kept_proof(evidence.api, fact.where.field)
            yield Case(fact.where, False, expected, f"it has changed by turn {changed.seen}", proof)


def _of(evidence: ProbeEvidence, kind: type[T], field: str) -> Iterator[Fact[T]]:
    """Facts of a kind about one field."""
    return (fact for fact in evidence.facts(kind) if fact.where.field == field)


def _is_one_for_all(evidence: ProbeEvidence, field: str) -> bool:
    """Tells whether agents share memory that is used again: one fault, which one check tells."""
    is_shared = any(fact.value.pair for fact in _of(evidence, SharedValues, field))
    return is_shared and any(fact.value.changed for fact in _of(evidence, KeptValues, field))


def without_state(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why no value of `state()` can change: there is none, or it is plain."""
    fields = {fact.where.field for fact in evidence.facts(KeptValues)}
    return "it has no state() that hands out arrays" if fields and "state" not in fields else None


def apart_cases(evidence: ProbeEvidence, field: str) -> Cases:
    """Yields a case for every pair of agents whose memory was compared."""
    for fact in _of(evidence, SharedValues, field):
        pair = fact.value.pair
        for _ in range(fact.value.looks - fact.value.shared):
            yield Case(fact.where, True)
        if pair is not None:
            one, other = pair
            yield from [
                Case(
                    fact.where,
                    False,
                    "memory of its own for each agent",
                    f"{one!r} and {other!r} were given the same",
                    proof=_apart_proof(evidence.api, field, one, other),
                )
            ] * fact.value.shared


def _kept_proof(api: str, field: str) -> Reproducer:
    """Plays, keeps everything beside a copy, and compares at the end."""
    value = "env.state()" if field == "state" else f"out[{PLACES[field]}]"
    if api == "parallel":
        first = value if field in ("observations", "infos", "state") else "{}"
        lines = (
            "env = make()\n"
            "out = env.reset(seed=SEED)\n"
            f"value = {first}\n"
            "given = [(value, copy.deepcopy(value))]\n"
            "for actions in ACTIONS:\n"
            "    out = env.step(actions)\n"
            f"    value = {value}\n"
            "    given.append((value, copy.deepcopy(value)))\n"
        )
    else:
        lines = (
            "env = make()\n"
            "env.reset(seed=SEED)\n"
            "given = []\n"
            "for turn in range(len(ACTIONS) + 1):\n"
            "    if not env.agents:\n"
            "        break\n"
            "    out = env.last()\n"
            f"    value = {value}\n"
            "    given.append((value, copy.deepcopy(value)))\n"
            "    if turn < len(ACTIONS):\n"
            "        env.step(ACTIONS[turn])\n"
        )
    lines += "for value, copied in given:\n    np.testing.assert_equal(value, copied)"
    return Reproducer(lines, plays=False, imports=("copy",))


def _apart_proof(api: str, field: str, one: object, other: object) -> str:
    """Changes what one was given, and looks at what the other was given."""
    agents = key_literal(one), key_literal(other)
    if api == "parallel":
        mine, theirs = (f"{field}[{agent}]" for agent in agents)
    elif field == "infos":
        mine, theirs = (f"env.infos[{agent}]" for agent in agents)
    else:
        mine, theirs = (f"env.observe({agent})" for agent in agents)
    return (
        "def arrays(value):\n"
        "    items = value.values() if isinstance(value, dict) else value\n"
        "    if isinstance(value, np.ndarray):\n"
        "        return [value] if value.dtype.kind in 'biufc' and value.ndim else []\n"
        "    if isinstance(value, (dict, list, tuple)):\n"
        "        return [array for item in items for array in arrays(item)]\n"
        "    return []\n"
        f"mine, theirs = {mine}, {theirs}\n"
        "assert mine is not theirs, mine\n"
        "for a in arrays(mine):\n"
        "    assert not any(np.shares_memory(a, b) for b in arrays(theirs)), a"
    )


@check("GK610", HIGH, "kept")
def observations_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A returned observation doesn't change at a later turn.

    A replay buffer keeps observations by reference. Where the environment writes the next one into
    the same array, all that was learned from the earlier ones was learned from wrong data.

    Bad:
        def observe(self, agent):
            self.planes[agent][...] = self.board == self.token[agent]
            return self.planes[agent]           # the same array at every turn

    Good:
        def observe(self, agent):
            return (self.board == self.token[agent]).astype(np.int8)

    Fix: return a new array from every call (or a copy of the buffer), the mask's too
    """
    yield from kept_cases(evidence, "observations")


@check("GK611", MEDIUM, "kept")
def infos_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A returned info, and an action mask in it, doesn't change at a later turn.

    A buffer that keeps infos, masks above all, for learning later then has those of another turn.

    Bad:
        self.infos[agent]["action_mask"] = self.legal       # one array, written to at every step

    Good:
        self.infos[agent] = {"action_mask": self.legal.copy()}

    Fix: build a new info for every step, with copies of arrays such as action masks
    """
    if not _is_one_for_all(evidence, "infos"):  # GK615 tells it
        yield from kept_cases(evidence, "infos")


@check("GK612", HIGH, "kept", applies=without_state)
def states_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Values that state() returned don't change at a later turn.

    A central critic that keeps states by reference learns from the last one alone.

    Bad:
        def state(self):
            return self.world               # the array that step() writes to

    Good:
        def state(self):
            return self.world.copy()

    Fix: return a copy from state(): `return self.world.copy()`
    """
    yield from kept_cases(evidence, "state")


@check("GK613", MEDIUM, "kept", api="parallel")
def dictionaries_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The dictionaries of rewards and endings that step returned don't change at a later step.

    A rollout that is kept step by step, as every learner does, holds the last step's rewards again
    and again. (The attributes of an AEC environment are another thing: those are written in place.)

    Bad:
        for agent in self.agents:
            self.rewards[agent] = self.score(agent)
        return observations, self.rewards, ...

    Good:
        rewards = {agent: self.score(agent) for agent in self.agents}
        return observations, rewards, ...

    Fix: return new dictionaries from every step: `return obs, dict(self.rewards), ...`
    """
    yield from kept_cases(evidence, "rewards", "terminations", "truncations")


@check("GK614", MEDIUM, "kept")
def observations_are_apart(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The observations of two agents share no memory that can be written to.

    A wrapper that normalises one agent's observation in place normalises the other's as well.
    Equal observations are fine in arrays of their own, or in one that is read-only, holds texts or
    has no axis.

    Bad:
        view = self.board_view()
        return {agent: view for agent in self.agents}

    Good:
        return {agent: self.board_view() for agent in self.agents}

    Fix: give each agent an array of its own: `{agent: view.copy() for agent in self.agents}`
    """
    if not _is_one_for_all(evidence, "observations"):  # GK610 tells it
        yield from apart_cases(evidence, "observations")


@check("GK615", MEDIUM, "kept")
def infos_are_apart(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The infos of two agents are not one dictionary, nor do they share an array.

    An entry that is put into one agent's info, by a wrapper for instance, stands in the other's
    too.

    Bad:
        infos = dict.fromkeys(self.agents, {})

    Good:
        infos = {agent: {} for agent in self.agents}

    Fix: `{agent: {} for agent in self.agents}`, not `dict.fromkeys(self.agents, {})`
    """
    yield from apart_cases(evidence, "infos")


def written_cases(evidence: ProbeEvidence, kind: str) -> Cases:
    """Yields a case for every episode in which things of this kind were overwritten."""
    for fact in evidence.facts(WrittenValues):
        if fact.where.field == kind:
            seen = fact.value.seen or "it goes on the same"
            yield Case(fact.where, fact.value.seen is None, GOES_ON, seen, fact.proof)


def none_of(kind: str, reason: str) -> Callable[[Contract, ProbeEvidence], str | None]:
    """Says that nothing of this kind can be written into, where that was looked at."""

    def against(contract: Contract, evidence: ProbeEvidence) -> str | None:
        kinds = {fact.where.field for fact in evidence.facts(WrittenValues)}
        return reason if kinds and kind not in kinds else None

    return against


@check(
    "GK620",
    HIGH,
    "written",
    applies=none_of("observations", "observations hold no array that can be written to"),
)
def written_observations_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an observation doesn't change the episode.

    Wrappers and learners scale observations in place. Where those are the game's own arrays, an
    agent moves pieces by looking at them.

    Bad:
        def observe(self, agent):
            return self.board

    Good:
        def observe(self, agent):
            return self.board.copy()

    Fix: return copies: no array that the rules, or a cache, will read again
    """
    yield from written_cases(evidence, "observations")


@check(
    "GK621", HIGH, "written", applies=none_of("infos", "infos hold no array that can be written to")
)
def written_infos_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an array of an info doesn't change the episode.

    Wrappers scale what they find there in place. Where it is the game's own array, they move it.

    Bad:
        infos[agent] = {"position": self.position[agent]}       # a view of the game's own array

    Good:
        infos[agent] = {"position": self.position[agent].copy()}

    Fix: put copies into infos: `{"position": self.position.copy()}`
    """
    yield from written_cases(evidence, "infos")


@check(
    "GK622",
    HIGH,
    "written",
    applies=none_of("state", "it has no state() that only looks and hands out arrays"),
)
def written_states_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into the result of state() doesn't change the episode.

    A central critic that normalises its input in place would move the agents themselves.

    Bad:
        def state(self):
            return self.world

    Good:
        def state(self):
            return self.world.copy()        # the caller's own

    Fix: return a copy from state(): `return self.world.copy()`
    """
    yield from written_cases(evidence, "state")


@check("GK623", LOW, "written", api="parallel")
def emptied_dictionaries_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Emptying the dictionaries that reset and step returned doesn't change the episode.

    Wrappers take entries of agents that are gone out of them. Where they are the environment's own
    books, its next step crashes or forgets who has ended. Only a caller that deletes entries is
    hurt, so the severity is low.

    Bad:
        return observations, self.rewards, self.terminations, self.truncations, self.infos

    Good:
        return observations, dict(self.rewards), dict(self.terminations), ...

    Fix: return new dictionaries: `return observations, dict(self.rewards), ...`
    """
    yield from written_cases(evidence, "dictionaries")


@check(
    "GK624",
    MEDIUM,
    "written",
    applies=none_of("masks", "no action mask is handed out that can be written to"),
)
def written_masks_change_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an action mask, in an observation or an info, doesn't change what is legal.

    An agent that edits its mask, to forbid more to itself or by a normalisation in place, must not
    change the rules for itself or for others.

    Bad:
        infos[agent] = {"action_mask": self.legal}      # the array that step() asks

    Good:
        infos[agent] = {"action_mask": self.legal.copy()}

    Fix: hand out a copy of the mask: `{"action_mask": self.legal.copy()}`
    """
    yield from written_cases(evidence, "masks")


def handed_cases(
    evidence: ProbeEvidence, kind: type[HandedActions] | type[HandedOptions], proof: Reproducer
) -> Cases:
    """Yields a case for every look at what was handed over."""
    for fact in evidence.facts(kind):
        changed = fact.value.changed
        for _ in range(fact.value.looks - (changed is not None)):
            yield Case(fact.where, True)
        if changed is not None:
            yield Case(fact.where, False, shown(changed.before), shown(changed.after), proof=proof)


def no_writable_actions(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Says that no action that was handed over can be written into."""
    was_played = any(evidence.facts(HandedOptions))
    if was_played and not any(evidence.facts(HandedActions)):
        return "actions are plain numbers, which nobody can write into"
    return None


@check("GK630", HIGH, "handed_over", applies=no_writable_actions)
def step_leaves_actions_alone(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """step() doesn't change the actions that it is given, nor their dictionary.

    A replay buffer keeps the action that was chosen. Where step scales or clips the caller's array
    in place, the learner is told that it had chosen something else.

    Bad:
        push = actions[agent]
        push *= 0.1

    Good:
        push = 0.1 * actions[agent]

    Fix: compute with a copy: `push = 0.1 * actions[agent]`, not `actions[agent] *= 0.1`
    """
    yield from handed_cases(evidence, HandedActions, reproducer_of(actions_stay))


@check("GK631", HIGH, "handed_over", applies=no_writable_actions)
def actions_are_read_in_their_step(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an action after its step doesn't change the episode: step keeps no reference.

    Learners re-use their buffers of actions. Where the environment reads an earlier action again,
    for an observation or for inertia, it reads the later one.

    Bad:
        self.last_actions = actions                     # read when the next observation is made

    Good:
        self.last_actions = {agent: np.array(actions[agent]) for agent in actions}

    Fix: keep a copy of what is needed after the step: `self.last_action = np.array(action)`
    """
    for counterfactual in evidence.counterfactuals("handed_over"):
        first_divergence = counterfactual.divergence
        if counterfactual.noise is not None:
            continue
        if first_divergence is None:
            yield Case(counterfactual.base.at(None, None, "kept"), True)
            continue
        where = counterfactual.base.at(env_steps_of(first_divergence), None, "kept")
        proof = reproducer_of(actions_are_read_at_once, compares=True)
        yield Case(where, False, GOES_ON, first_divergence_words(first_divergence), proof)


LINES = """\
env, options = make(), {}
env.reset(seed=SEED, options=options)
assert options == {}, options"""


@check("GK632", LOW, "handed_over")
def reset_leaves_options_alone(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """reset() doesn't change the options that it is given.

    One dictionary of options is handed to every reset, of several environments perhaps: what one
    reset writes into it governs all the others.

    Bad:
        options.setdefault("wind", self.rng.uniform())

    Good:
        wind = (options or {}).get("wind", self.rng.uniform())

    Fix: work with a copy: `options = {**DEFAULTS, **(options or {})}`
    """
    yield from handed_cases(evidence, HandedOptions, Reproducer(LINES, plays=False))
