"""Checks of evidence: it replays, and agents have names."""

from collections import Counter

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.episode_facts import AgentNames, UnwrittenActions
from gamekeeper.checks.paired_episodes import counterfactual_cases
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract

REPLAY_PROOF = (
    "assert not any('object at' in repr(each) for each in ACTIONS), 'these are no values'"
)


@check("GK901", HIGH, "evidence", looks_at="an episode in which no step raised")
def evidence_replays(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An episode replays bit for bit from its evidence: seed, options and recorded actions.

    A recording is all that a later reader has. Where the same actions from the same seed give
    another episode already, this check says nothing: that is for the checks of seeds (GK6xx).

    Bad:
        class Orders(gymnasium.Space):
            def sample(self, mask=None):
                return Order(self.np_random)       # an object that no file holds

    Good:
        self.action_spaces = {agent: Discrete(5) for agent in self.possible_agents}

    Fix: take actions as numbers, texts and arrays in an ordinary space, and let step() depend on
    their values alone
    """  # the claim is one line
    for counterfactual in evidence.counterfactuals("evidence"):
        yield from counterfactual_cases(
            counterfactual, "the episode as it was recorded", Reproducer(REPLAY_PROOF)
        )
    for fact in evidence.facts(UnwrittenActions):
        yield Case(
            fact.where, False, "actions that can be written", fact.value.reason, proof=REPLAY_PROOF
        )


NAMES_PROOF = (
    "names = [str(agent) for agent in dict.fromkeys([*env.possible_agents, *env.agents])]\n"
    "assert len(set(names)) == len(names), names\nassert all(names), names"
)
VALUES_PROOF = Reproducer(
    """\
env = make()
env.reset(seed=SEED)
agents = list(env.agents)
assert copy.deepcopy(agents) == agents, agents""",
    plays=False,
    imports=("copy",),
)


@check("GK902", MEDIUM, "evidence")
def agents_can_be_told_apart_as_text(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Agents' names are values that differ as text, and none is empty.

    Tables, files and most trainers know agents by their text; the int 1 and the text "1" become
    one. Agents that aren't texts are fine as long as their texts differ and each equals a copy of
    itself: an object that is equal to itself alone is another agent in every instance, in worker
    processes, and after a reset that makes it anew.

    Bad:
        self.possible_agents = [1, "1"]
        self.agents = [Ant() for _ in range(2)]

    Good:
        self.possible_agents = ["player_1", "judge_1"]

    Fix: give every agent a name of its own, as text, and keep what belongs to it by that name
    """
    for fact in evidence.facts(AgentNames):
        counted = Counter(text for text, _ in fact.value.names)
        alike = [text for text, count in counted.items() if count > 1 or not text]
        seen = alike or list(counted)
        yield Case(fact.where, not alike, "texts that differ", seen, proof=NAMES_PROOF)
        single = fact.value.no_values
        expected = "agents that equal their copies"
        yield Case(fact.where, not single, expected, single or "they do", proof=VALUES_PROOF)
