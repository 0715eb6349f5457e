"""Checks of calls that only look."""

from collections.abc import Callable

from gamekeeper.checks.case import Case, Cases, Reproducer
from gamekeeper.checks.check import HIGH, MEDIUM, check
from gamekeeper.checks.compared_reproducer import env_steps_of, first_divergence_words, story_proof
from gamekeeper.checks.facts.handed_facts import OfferedCalls, RepeatedLast
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.contract import Contract

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
"""Calls between the steps, as Python, by kind of call."""


def extra_call_cases(evidence: ProbeEvidence, kind: str) -> Cases:
    """Yields a case for every episode in which this kind of call was made more often.

    An episode with calls of all kinds that went another way accuses none of them: each was tried
    alone.
    """
    for counterfactual in evidence.counterfactuals("extra_calls"):
        calls = tuple(counterfactual.change["calls"])
        first_divergence = counterfactual.divergence
        if kind not in calls or (first_divergence is not None and len(calls) > 1):
            continue
        if kind == "sample" and first_divergence is not None and _is_blamed(evidence, "spaces"):
            continue  # who samples asks for the space first
        if first_divergence is None:
            yield Case(counterfactual.base.at(None, None, kind), True)
        elif "next" in counterfactual.change:
            where = counterfactual.base.at(counterfactual.change["next"], None, kind)
            expected = "the next reset goes on drawing as if nobody had called"
            seen = f"after a reset without a seed {first_divergence_words(first_divergence)}"
            yield Case(where, False, expected, seen, _proof(evidence.api, kind, is_next=True))
        else:
            where = counterfactual.base.at(env_steps_of(first_divergence), None, kind)
            expected = "the episode goes on as if nobody had called"
            seen = first_divergence_words(first_divergence)
            yield Case(where, False, expected, seen, _proof(evidence.api, kind))


def _is_blamed(evidence: ProbeEvidence, kind: str) -> bool:
    counterfactuals = evidence.counterfactuals("extra_calls")
    return any(
        list(t.change["calls"]) == [kind] and t.divergence is not None for t in counterfactuals
    )


def not_offered(kind: str) -> Callable[[Contract, ProbeEvidence], str | None]:
    """Says that there is no such call, where that was looked at."""

    def against(contract: Contract, evidence: ProbeEvidence) -> str | None:
        offered = [fact.value.kinds for fact in evidence.facts(OfferedCalls)]
        if offered and not any(kind in each for each in offered):
            return f"it answers no such call ({kind})"
        return None

    return against


def _proof(api: str, kind: str, *, is_next: bool = False) -> Reproducer:
    return story_proof(api, MEDDLING[kind], early=True, is_next=is_next)


@check("GK633", MEDIUM, "extra_calls", applies=not_offered("spaces"))
def asking_for_spaces_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Calling observation_space() and action_space() in mid-episode doesn't change the episode.

    Policies and wrappers ask for spaces at any time, some of them at every step.

    Bad:
        def action_space(self, agent):
            return Discrete(5, seed=int(self.rng.integers(1000)))       # draws at every call

    Good:
        def action_space(self, agent):
            return self.action_spaces[agent]

    Fix: build the spaces once, in __init__, and hand out the same ones at every call
    """
    yield from extra_call_cases(evidence, "spaces")


@check("GK634", HIGH, "extra_calls", api="aec", applies=not_offered("observe"))
def observing_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Calling observe() again, for every agent, doesn't change the episode.

    Loggers, wrappers and centralised learners observe more often than the loop. Where observe()
    draws from the game's generator or advances something, the game depends on who is watching.

    Bad:
        def observe(self, agent):
            return self.position[agent] + self.rng.normal(size=2)      # draws at every look

    Good:
        def step(self, action):
            ...
            self.noise = self.rng.normal(size=2)                        # once a turn

    Fix: keep noise and counters out of observe(): compute them in step()
    """
    yield from extra_call_cases(evidence, "observe")


TWICE = """\
first, second = env.last(), env.last()
assert first[1:4] == second[1:4], (first[1:4], second[1:4])"""


@check("GK635", HIGH, "extra_calls", api="aec", applies=not_offered("last"))
def asking_last_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Calling last() twice in a turn gives the same twice, and doesn't change the episode.

    Wrappers call last() beside the loop that plays. Where it pays out, clears or draws, the second
    call gets something else, and so does everybody after it.

    Bad:
        def last(self, observe=True):
            out = super().last(observe)
            self._cumulative_rewards[self.agent_selection] = 0     # paid out by being asked
            return out

    Good: clear the agent's cumulative reward in its own `step`.

    Fix: leave last() as AECEnv has it, and compute in step() what it shows
    """
    yield from extra_call_cases(evidence, "last")
    for fact in evidence.facts(RepeatedLast):
        told = fact.value.told
        for _ in range(fact.value.looks - (told is not None)):
            yield Case(fact.where, True)
        if told is not None:
            yield Case(
                fact.where, False, f"reward and flags {told[0]} again", f"{told[1]}", proof=TWICE
            )


@check("GK636", HIGH, "extra_calls", applies=not_offered("state"))
def asking_for_the_state_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Calling state() doesn't change the episode, nor draw from its generator.

    Centralised critics ask for the state at every step, evaluations don't: with one seed they play
    different games.

    Bad:
        def state(self):
            return self.table() + self.rng.normal(0, 0.01, self.shape)

    Good:
        def state(self):
            return self.table()

    Fix: let state() only read: draw noise in step(), or from a generator of its own
    """
    yield from extra_call_cases(evidence, "state")


@check("GK637", HIGH, "extra_calls", applies=not_offered("render"))
def rendering_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Calling render() between the steps doesn't change the episode, nor draw from its generator.

    A video of an episode then shows another episode than the one that was evaluated.

    Bad:
        def render(self):
            self.clouds += self.rng.normal(size=2)      # the generator of the game
            return self.paint()

    Good: keep `self.decor = np.random.default_rng(0)` for whatever is only painted.

    Fix: let render() only read; what it draws at random comes from a generator of its own
    """
    yield from extra_call_cases(evidence, "render")


@check("GK638", HIGH, "extra_calls", applies=not_offered("sample"))
def sampling_a_space_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Sampling from the returned spaces doesn't change the episode.

    Every random policy samples actions. Where the environment draws from the generators of its
    spaces, what happens depends on how often anybody has sampled.

    Bad:
        wind = self.action_space(agent).sample()

    Good:
        wind = self.rng.integers(5)

    Fix: draw from the environment's own generator, never from a space's `np_random`
    """
    yield from extra_call_cases(evidence, "sample")


@check("GK639", MEDIUM, "extra_calls", applies=not_offered("attributes"))
def asking_for_attributes_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Reading num_agents, metadata, unwrapped or str(env) doesn't change the episode.

    Progress bars, loggers and debuggers read them at any time.

    Bad:
        @property
        def num_agents(self):
            self.purge()                    # takes out who has ended
            return len(self.agents)

    Good: whatever changes the game happens in `step`.

    Fix: let attributes and str() only read
    """
    yield from extra_call_cases(evidence, "attributes")
