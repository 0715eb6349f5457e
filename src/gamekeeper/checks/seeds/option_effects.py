"""Check of the options of a reset: they hold for one episode."""

from gamekeeper.checks.check import LOW, Cases, check
from gamekeeper.checks.literal import literal
from gamekeeper.checks.paired_episodes import parted, program, settled_by_seed, told_of
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract


@check(
    "GK616",
    LOW,
    "options",
    applies=settled_by_seed,
    looks_at="an option that reset asks for and that changes an episode, with a default or an "
    "attribute of its name that is a number or a bool",
)
def options_hold_for_one_episode(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The options of a reset hold for its episode: one without options goes as if none were given.

    A curriculum or an evaluation that hands options to one reset would change every later episode,
    also those that are replayed from their seed alone. It is of low severity, as some options are
    meant to stay. Tested with the options that `reset` itself asks for, each with another value
    than its default.

    Bad:
        self.size = options.get("size", self.size)

    Good:
        size = options.get("size", self.default_size)

    Fix: take the default of an option from what the constructor was given, not from the last reset
    """
    for each in evidence.counterfactuals("options"):
        if each.change["change"] != "options before":
            continue
        tells = told_of(contract, each)
        key, value = each.change["option"], each.change["value"]
        lines = (
            "used, plain = make(), make()",
            "plain.reset(seed=SEED)",
            f"used.reset(seed=SEED, options={{{literal(key)}: {literal(value)}}})",
            "alike(play(used), play(plain))",
        )
        unchanged = (*lines[:2], "used.reset(seed=SEED)", lines[3])
        proof = program(evidence.api, *lines, tells=tells, unchanged=unchanged)
        expected = f"the same episode as without {key!r} in the reset before"
        yield from parted(each, proof, expected=expected)
