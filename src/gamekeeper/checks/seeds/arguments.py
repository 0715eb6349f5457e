"""Checks of what is handed over to an environment: actions and options stay as they are."""

from __future__ import annotations

from gamekeeper.checks.case import Case, Cases, Reproducer
from gamekeeper.checks.check import HIGH, LOW, check
from gamekeeper.checks.facts.handed_facts import HandedActions, HandedOptions
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import actions_are_read_at_once, actions_stay
from gamekeeper.checks.story import env_steps_of, first_divergence_words
from gamekeeper.contract import Contract
from gamekeeper.episodes.canonical import shown


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


@check(
    "GK630",
    needs=("handed_over",),
    severity=HIGH,
    fix="compute with a copy: `push = 0.1 * actions[agent]`, not `actions[agent] *= 0.1`",
    applies=no_writable_actions,
)
def step_leaves_actions_alone(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The actions that are handed to step, and their dictionary, are as before once it returns.

    A replay buffer keeps the action that was chosen. Where step scales or clips the caller's array
    in place, the learner is told that it had chosen something else.

    Bad:
        push = actions[agent]
        push *= 0.1

    Good:
        push = 0.1 * actions[agent]
    """
    yield from handed_cases(evidence, HandedActions, reproducer_of(actions_stay))


@check(
    "GK631",
    needs=("handed_over",),
    severity=HIGH,
    fix="keep a copy of what is needed after the step: `self.last_action = np.array(action)`",
    applies=no_writable_actions,
)
def actions_are_read_in_their_step(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Writing into an action after its step doesn't change the game: step keeps no reference.

    Learners re-use their buffers of actions. Where the environment reads an earlier action again,
    for an observation or for inertia, it reads the later one.

    Bad:
        self.last_actions = actions                     # read when the next observation is made

    Good:
        self.last_actions = {agent: np.array(actions[agent]) for agent in actions}
    """
    for counterfactual in evidence.counterfactuals("handed_over"):
        first_divergence = counterfactual.divergence
        if counterfactual.noise is not None:
            continue
        if first_divergence is None:
            yield Case(counterfactual.base.at(None, None, "kept"), True)
            continue
        where = counterfactual.base.at(env_steps_of(first_divergence), None, "kept")
        expected = "the play goes on as if nothing was written"
        proof = reproducer_of(actions_are_read_at_once, compares=True)
        yield Case(where, False, expected, first_divergence_words(first_divergence), proof)


LINES = """\
env, options = make(), {}
env.reset(seed=SEED, options=options)
assert options == {}, options"""


@check(
    "GK632",
    needs=("handed_over",),
    severity=LOW,
    fix="work with a copy: `options = {**DEFAULTS, **(options or {})}`",
)
def reset_leaves_options_alone(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The options that are handed to reset are as before once it returns.

    One dictionary of options is handed to every reset, of several environments perhaps: what one
    reset writes into it governs all the others.

    Bad:
        options.setdefault("wind", self.rng.uniform())

    Good:
        wind = (options or {}).get("wind", self.rng.uniform())
    """
    yield from handed_cases(evidence, HandedOptions, Reproducer(LINES, plays=False))
