"""Checks of legal and illegal actions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import ended_in
from gamekeeper.checks.facts.action_facts import TriedAction
from gamekeeper.checks.facts.episode_facts import RaisedCall
from gamekeeper.checks.literal import step_literal
from gamekeeper.checks.probe_evidence import ProbeDeath, ProbeEvidence, ProbeRun
from gamekeeper.checks.spaces.action_masks import (
    fits,
    is_legal,
    mask_of,
    mask_parts,
    mask_places,
    stands_elsewhere,
    without_masks,
)
from gamekeeper.checks.spaces.observation_values import spaces_of
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn


@dataclass(frozen=True, slots=True)
class LegalTurn:
    """A turn at which live agents acted, all of them legally.

    Attributes:
        agent: the agent that acted; None of a Parallel step, in which all act.
        is_masked: a mask said to one of them what is legal.
        is_bound: such a mask forbade something.
        raised: what the step raised, in words; None where it was accepted.
    """

    episode: Episode
    turn: Turn
    agent: str | None
    is_masked: bool
    is_bound: bool
    raised: str | None


def legal_turns(contract: Contract, evidence: ProbeEvidence) -> Iterator[LegalTurn]:
    """Turns of rollouts at which live agents acted.

    Random play is legal by its making. Where a step raised, every turn is looked at, as the actions
    may come from elsewhere: then it is turns up to the first that isn't legal, or can't be judged.
    """
    known = spaces_of(evidence, "action")
    for look in evidence.looks.get("rollout", ()):
        raised = _raised(look)
        for episode in look.episodes:
            for turn in episode.turns:
                ended = ended_in(turn)
                acting = [agent for agent in turn.order if agent not in ended]
                if not acting:
                    continue
                masks = {agent: mask_of(contract, turn, agent) for agent in acting}
                if raised and not all(_plays(known, turn, each, masks[each]) for each in acting):
                    break
                if any(stands_elsewhere(known.get(each), turn, each) for each in acting):
                    break
                said = raised if turn.raised else None
                given = {agent: mask for agent, mask in masks.items() if mask is not None}
                bound = any(_forbids(known.get(agent), mask) for agent, mask in given.items())
                agent = acting[0] if evidence.api == "aec" else None
                yield LegalTurn(episode, turn, agent, bool(given), bound, said)


def _plays(known: dict[str, Any], turn: Turn, agent: str, mask: Any) -> bool:
    space, action = known.get(agent), turn.actions.get(agent)
    return space is not None and action is not None and is_legal(space, mask, action)


def _raised(look: ProbeRun) -> str | None:
    """Exception of a step in this episode, in words."""
    raised = look.fact(RaisedCall)
    if raised is None or raised.value.call != "step":
        return None
    return f"{raised.value.kind}: {raised.value.text}"


def illegal_proof(api: str, turn: int | None, value: TriedAction, then: str) -> Reproducer:
    """Lines that play up to the illegal action, take it, and go on with `then`.

    Args:
        turn: the turn of the illegal action.
        value: what was tried.
        then: lines that raise; `out` is what the step gave, `error` what it raised.
    """
    return Reproducer(
        "env = make()\n"
        "env.reset(seed=SEED)\n"
        f"for actions in ACTIONS[:{turn}]:\n"
        "    env.step(actions)\n"
        "out = error = None\n"
        "try:\n"
        f"    out = env.step({step_literal(api, value.action)})\n"
        "except Exception as raised:\n"
        "    error = raised\n"
        f"{then}",
        plays=False,
    )


def _forbids(space: Any, mask: Any) -> bool:
    """Tells whether a mask of the space's form forbids an action."""
    if space is None or fits(space, mask) is not None:
        return True
    return not all(np.all(part) for part in mask_parts(space, mask))


def _may_blame_masks(turns: Sequence[LegalTurn]) -> bool:
    """Tells whether a step was accepted or a mask forbade something; else `step` takes nothing."""
    return any(each.raised is None or each.is_bound for each in turns)


PROOF = "# nothing more: a step above raised, and every action in it is one of its action space"


RANDOM_PLAY: Final = """
from collections.abc import Mapping

def sampled(agent, observation, info):
    parts = observation if isinstance(observation, Mapping) else {}
    mask = parts.get("action_mask", info.get("action_mask"))
    return env.action_space(agent).sample(mask)

env = make()
start = env.reset(seed=SEED)
for agent in env.possible_agents:
    env.action_space(agent).seed(SEED)
"""
PLAYS_ON: Final = {
    "parallel": f"""{RANDOM_PLAY}observations, infos = start
for _ in range(500):
    if not env.agents:
        observations, infos = env.reset()
    actions = {{each: sampled(each, observations[each], infos[each]) for each in env.agents}}
    observations, *_, infos = env.step(actions)
""",
    "aec": f"""{RANDOM_PLAY}for _ in range(500):
    if not env.agents:
        env.reset()
    agent = env.agent_selection
    observation, _, terminated, truncated, info = env.last()
    env.step(None if terminated or truncated else sampled(agent, observation, info))
""",
}
"""Random legal actions, which end the process of an environment that kills it."""


def _deaths(evidence: ProbeEvidence) -> Cases:
    """Rollouts in which the environment ended its process; what is out of memory may be sound."""
    for death in evidence.facts(ProbeDeath):
        said = death.value.text
        if death.where.probe == "rollout" and said.startswith("died") and "SIGKILL" not in said:
            proof = Reproducer(PLAYS_ON[evidence.api], plays=False)
            where = replace(death.where, field="raised")
            yield Case(
                where, False, "an episode that ends no process", f"the process {said}", proof
            )


@check(
    "GK221",
    HIGH,
    "rollout",
    "spaces",
    "illegal",
    looks_at="a step of agents that have no action mask",
)
def actions_of_the_space_are_accepted(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every action of the action space is accepted: `step` raises nothing.

    A policy chooses from the action space and knows no other rule, unless a mask tells it. A step
    that raises ends a training after hours, mostly in a corner that random play seldom reaches: at
    the very bounds of a Box, or with an action that is an int and no np.int64.

    Bad:
        self.action_spaces[agent] = Discrete(6)        # and action 5 is an index past the end

    Good:
        self.action_spaces[agent] = Discrete(5)

    Fix: take every action of the action space, make the space smaller, or give an action mask
    """
    yield from _deaths(evidence)
    for fact in evidence.facts(TriedAction):
        if not fact.value.is_legal:
            continue
        raised, then = fact.value.raised, "assert error is None, error"
        proof = illegal_proof(evidence.api, fact.where.turn, fact.value, then)
        expected = "a step that takes an action of the space"
        yield Case(fact.where, raised is None, expected, raised, proof)
    turns = list(legal_turns(contract, evidence))
    may_blame_masks = _may_blame_masks(turns)
    for taken in turns:
        if not taken.is_masked or not may_blame_masks:
            where = taken.episode.at(taken.turn, taken.agent, "raised")
            expected = "a step that takes actions of the action space"
            yield Case(where, taken.raised is None, expected, taken.raised, PROOF)


@check("GK222", MEDIUM, "illegal")
def illegal_actions_break_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An illegal action is taken or refused, and after it a reset starts a playable episode.

    An environment may raise whatever it likes, or coerce the action. But a process that dies, and
    an instance that can't be reset any more, take a whole training with them.

    Bad:
        self.is_stepping = True
        position = MOVES[action]               # raises; is_stepping stays, and reset() refuses

    Good:
        if not self.action_space(agent).contains(action):
            raise ValueError(f"{agent}: {action!r} is no action")

    Fix: refuse an illegal action before anything is changed, and let reset() start from nothing
    """
    for death in evidence.facts(ProbeDeath):
        if death.where.probe == "illegal":
            said = f"the process {death.value.text}"
            yield Case(death.where, False, "an exception at most", said)
    for fact in evidence.facts(TriedAction):
        if fact.value.is_legal:
            continue
        value = fact.value
        is_ok = value.again is None
        seen = f"after the action ({value.case}) {value.again}"
        proof = illegal_proof(evidence.api, fact.where.turn, value, AGAIN)
        yield Case(fact.where, is_ok, "a reset that starts a playable episode", seen, proof)


AGAIN = "env.reset(seed=SEED)\nfor actions in ACTIONS:\n    env.step(actions)"


def _none_declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    is_declared = any(role.illegal is not None for role in contract.roles.values())
    return None if is_declared else "the contract says of no role what a masked action brings"


@check("GK237", HIGH, "illegal", applies=_none_declared)
def masked_actions_bring_what_is_declared(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An action that the mask forbids raises, costs, or ends, as the contract declares.

    A learner without masks learns the rules from this alone: if what is forbidden is quietly taken,
    it learns another game.

    Bad:
        illegal = "error"             # and the environment plays the forbidden move

    Good:
        if not mask[action]: raise ValueError(f"{action} is forbidden now")

    Fix: do with a masked action what roles.<role>.illegal says, or declare what is done
    """
    for fact in evidence.facts(TriedAction):
        role = contract.role_of(fact.where.agent)
        declared = None if role is None else contract.roles[role].illegal
        value = fact.value
        if value.case != "masked" or declared is None:
            continue
        is_ok, then = _is_as(declared, value), _then(evidence.api, declared, str(fact.where.agent))
        proof = illegal_proof(evidence.api, fact.where.turn, value, then)
        yield Case(fact.where, is_ok, EXPECTED[declared], _seen(value), proof)


EXPECTED = {
    "error": "the step raises",
    "penalty": "the agent is paid less than for a legal action, or less than 0",
    "end": "the agent has ended",
}


def _is_as(declared: str, value: TriedAction) -> bool:
    if declared == "error":
        return value.raised is not None
    if value.raised is not None:
        return False
    if declared == "end":
        return bool(value.is_over)
    paid, legal = value.reward, value.legal_reward
    return paid is not None and (paid < 0 or (legal is not None and paid < legal))


def _seen(value: TriedAction) -> str:
    if value.raised is not None:
        return f"it raised {value.raised}"
    ended = "it has ended" if value.is_over else "it goes on"
    return f"the action was taken, it was paid {value.reward}, {ended}"


def _then(api: str, declared: str, agent: str) -> str:
    if declared == "error":
        return "assert error is not None, 'the forbidden action was taken'"
    lines = ["assert error is None, error"]
    if declared == "end":
        over = f"all(str(a) != {agent!r} for a in env.agents)"
        if api == "aec":
            flags = (
                "{**env.terminations, **{a: True for a in env.truncations if env.truncations[a]}}"
            )
            over += f" or any(f for a, f in {flags}.items() if str(a) == {agent!r})"
        lines.append(f"assert {over}, 'it goes on'")
    else:
        rewards = "out[1]" if api == "parallel" else "env.rewards"
        lines.append(f"reward = next(r for a, r in {rewards}.items() if str(a) == {agent!r})")
        lines.append("assert reward < 0, reward")
    return "\n".join(lines)


UNFINISHED: Final = (
    "# nothing more: a step above raised, and the masks given before it allow all its actions"
)


def _allowed_proof(
    contract: Contract, taken: LegalTurn, known: Mapping[str, Any]
) -> Reproducer | str:
    """Lines that step as long as the mask allows it, where it has a flag for each action."""
    turn, agent = taken.turn, taken.agent
    space = None if agent is None else known.get(agent)
    are_plain = all(isinstance(each, Discrete) for each in known.values())
    if agent is None or not isinstance(space, Discrete) or not are_plain:
        return UNFINISHED
    seen, info = turn.observations.get(agent), turn.infos.get(agent)
    places = (name for name, read in mask_places(contract, agent) if read(seen, info) is not None)
    side, _, path = next(places).partition(".")
    keys = "".join(f"[{key!r}]" for key in path.split("."))
    offset = f" - {space.start}" if space.start else ""
    return Reproducer(
        "env = make()\n"
        "env.reset(seed=SEED)\n"
        "for action in ACTIONS:\n"
        f"    mask = env.last()[{0 if side == 'observation' else -1}]\n"
        f"    if action is not None and not mask{keys}[action{offset}]:\n"
        "        break\n"
        "    env.step(action)\n"
        "# nothing more: a step above raised, and the mask given before it allows its action",
        plays=False,
    )


@check(
    "GK235",
    HIGH,
    "rollout",
    "spaces",
    applies=without_masks,
    looks_at="a step of agents with an action mask",
)
def allowed_actions_are_accepted(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every action that an action mask allows is accepted: the mask is neither wrong nor stale.

    A mask that was made before the last move, for another agent, or the wrong way round offers
    actions that the rules refuse.

    Bad:
        mask = board == 0                  # kept from before the other player's move

    Good:
        def observe(self, agent): return {..., "action_mask": self._legal_now(agent)}

    Fix: make the mask from the state that the action will meet, for the agent that will act
    """
    turns, known = list(legal_turns(contract, evidence)), spaces_of(evidence, "action")
    for taken in turns if _may_blame_masks(turns) else ():
        if taken.is_masked:
            where = taken.episode.at(taken.turn, taken.agent, "raised")
            expected = "a step that takes what the masks allow"
            proof = _allowed_proof(contract, taken, known) if taken.raised else UNFINISHED
            yield Case(where, taken.raised is None, expected, taken.raised, proof)
