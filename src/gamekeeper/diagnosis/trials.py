"""Trials of a diagnosis: set-ups with one thing at its ideal, which can isolate a cause."""

from __future__ import annotations

import contextlib
import copy
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Final, Literal

from gamekeeper.contract import Contract
from gamekeeper.contract.sections import Knob
from gamekeeper.diagnosis.open_setup import Setup, SetupTraits
from gamekeeper.diagnosis.setup_differences import ABSENT
from gamekeeper.diagnosis.undos import DRAWS, MESSAGES, BoundaryUndo
from gamekeeper.episodes.layout import role as role_in_name
from gamekeeper.episodes.outcome import LABELS, members_of
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.policy import REFERENCE
from gamekeeper.rollouts.interventions.perturbation import action_space, observation_space
from gamekeeper.rollouts.rollout_plan import MOST_TURNS

PERCEPTION, ESTIMATION, PLANNING, CONTROL, TIMING, DATA, EVALUATION = LABELS
EVERYBODY: Final = "*"
POLICY: Final = "policy"
MEMORY: Final = "memory"
CARRIED: Final = "carried over"
"""Component of what a policy's object keeps over its own reset, into later episodes."""
MOST_RENEWED: Final = 5
"""Objects of policies up to which two are renewed together."""
PEERS: Final = 2
"""Policies of others of its role that are tried in an agent's place."""
ENVIRONMENT: Final = "environment"
"""Label of a knob that is nobody's own fault: wind, ice."""
LONGER: Final = 4
"""Times as long as before an episode is, where the environment's own cut-off is moved."""
CUT_OFF: Final = "cut-off"
TUNES: Final = ("rescale", "normalize", "shift", "settle", "hold")
"""First words of undos that may quicken an agent with which nothing is wrong."""
SHIFTS: Final = ("shift field", "shift axis", "shift values")
PIXELS: Final = 255.0
"""A factor of an observation that is one of units, of pixels."""
COMPONENTS: Final = (*LABELS, POLICY, MEMORY, CARRIED, DRAWS, MESSAGES, ENVIRONMENT, CUT_OFF)
"""Components that are made ideal: a label where one boundary is touched; a whole policy, and all
that it keeps between turns, have none, as several of their parts could be at fault."""


@dataclass(frozen=True, slots=True, eq=False)
class IdealSubstitute:
    """One thing at its ideal.

    Attributes:
        name: what it does, as `observation_noise[carrier_0] = 0`.
        component: what is made ideal, one of `COMPONENTS`; of several, all of them joined by ` + `.
        agents: whose fault it cures; empty for a fault that is nobody's own.
        steps: what is set: (where, of whom, name, value).
        contains: names of the ideal substitutes that it makes up for.
        value: the number that it replaces, where it is one number.
        cut_off: it moves where episodes are cut off: to where the contract declares it, to where
            the environment does so by default, or to some later turn; the last two yield to
            whatever else restores.
        parts: of several at once, those.
        between: of an undo that touches messages alone: their speaker, then those that hear them.
        open_as: place of the fault in words, where an undo leaves its label open.
    """

    name: str
    component: str
    agents: tuple[str, ...]
    steps: tuple[tuple[str, str, str, Any], ...]
    contains: frozenset[str] = frozenset()
    value: float | None = None
    cut_off: Literal["declared", "default", "later"] | None = None
    parts: tuple[IdealSubstitute, ...] = ()
    between: tuple[str, ...] = ()
    open_as: str = ""

    @property
    def undo(self) -> BoundaryUndo | None:
        """The undo that it is; None: something is at its ideal, or it is several at once."""
        one = self.steps[0][3]
        return one if isinstance(one, BoundaryUndo) and not self.parts else None

    @property
    def is_pair(self) -> bool:
        """Tells whether it is undos of several agents at once."""
        return any(leaf.undo is not None for part in self.parts for leaf in part.leaves)

    @property
    def leaves(self) -> tuple[IdealSubstitute, ...]:
        """The single things that it makes ideal."""
        return tuple(leaf for part in self.parts for leaf in part.leaves) or (self,)

    @property
    def is_gain(self) -> bool:
        """Tells whether it enlarges an observation: for units, errors in it, weak actions."""
        undo = self.undo
        is_all = undo is not None and undo.way == "rescale fields" and not undo.places
        return undo is not None and is_all and 1 < undo.amount < PIXELS

    @property
    def is_tuning(self) -> bool:
        """Tells whether it may quicken an agent that has no fault: by a scale, a constant, a call.

        One of these shows nothing where the environment's own cut-off is late enough.
        """
        return self.undo is not None and self.undo.way.startswith(TUNES)

    @property
    def is_offset(self) -> bool:
        """Tells whether it adds a constant to a number, or multiplies it: sensor, action or aim."""
        undo = self.undo
        is_scale = undo is not None and undo.way in ("rescale fields", "rescale axes")
        return undo is not None and (undo.way in SHIFTS or (is_scale and bool(undo.places)))

    @property
    def labels(self) -> tuple[str, ...]:
        """The failures that it cures; none of a component that has several parts."""
        if self.between or self.is_gain or self.is_offset or self.open_as:
            return ()
        if self.is_pair:
            named = {label for part in self.parts for label in part.labels}
            return tuple(label for label in LABELS if label in named)
        return tuple(each for each in self.component.split(" + ") if each in LABELS)

    @property
    def concerned(self) -> tuple[str, ...]:
        """The agents whose fault it may be: of messages that a listener misreads the speaker too.

        What is undone at the speaker for several that hear it isn't any one listener's; where one
        alone hears it, that one may misread it.
        """
        if self.between and (self.agents != self.between[:1] or len(self.between) == 2):
            return tuple(dict.fromkeys((*self.between, *self.agents)))
        return self.agents

    @property
    def shown(self) -> str:
        """The place of the fault, as far as this shows it."""
        if self.cut_off == "later":
            return f"the cut-off of episodes by {self.steps[0][2]}, or policies too slow for it"
        if self.cut_off is not None:
            return f"the cut-off of episodes ({self.name} restores)"
        if self.component == ENVIRONMENT:
            return f"the environment's {self.steps[0][2]}"
        whose = f"{joined_names(self.agents)}'s " if self.agents else ""
        if self.is_gain:
            return f"{whose}gain, from what is observed to what is done"
        if self.is_offset:
            kind = "offset" if self.undo is not None and self.undo.way in SHIFTS else "factor"
            return (
                f"a constant {kind} in what {joined_names(self.agents)} observes, aims at or does"
            )
        if self.is_pair:
            return " and ".join(dict.fromkeys(part.shown for part in self.parts))
        if self.between:
            text = f"messages from {self.between[0]} to {joined_names(self.between[1:])}"
            is_own = len(self.between) > 2 and self.agents == self.between[:1]
            return f"{whose}{self.component} or {text}" if is_own else text
        if self.component == MESSAGES and self.undo is not None:
            names = f"{self.undo.names[0]} to {joined_names(self.undo.agents)}"
            return f"messages from {names}, late or lost on their way"
        if self.open_as:
            return f"{whose}{self.open_as}"
        names, is_one = joined_names(self.agents), len(self.agents) == 1
        words = {
            POLICY: f"{whose}{'policy' if is_one else 'policies'}",
            MEMORY: f"something that {names} keep{'s' if is_one else ''} between turns",
            CARRIED: f"something that {names} keep{'s' if is_one else ''} from episode to episode",
            DRAWS: f"what {names} draw{'s' if is_one else ''}",
        }
        parts = self.component.split(" + ")
        return " and ".join(words.get(part, f"{whose}{part}") for part in parts)

    def applied(self, setup: Setup) -> Setup:
        """The set-up with this at its ideal."""
        for step in self.steps:
            setup = _applied(setup, *step)
        return setup


def substitutes_of(
    setup: Setup,
    contract: Contract,
    traits: SetupTraits,
    replacements: Mapping[str, Any] | None = None,
) -> tuple[IdealSubstitute, ...]:
    """Every knob that isn't at its ideal, and for components with several of them all at once.

    Args:
        replacements: policies to be tried in agents' places, by agent, role or under `*`.
    """
    found: list[IdealSubstitute] = []
    for name, knob in contract.knobs.items():
        found += _of_knob(name, knob, setup, contract, traits)
    found += _of_protocol(setup, contract, traits.agents)
    found += _of_cut_offs(setup, traits)
    for agent in traits.agents if REFERENCE in traits.ways else ():
        if setup.policy_of(agent, contract) not in (None, REFERENCE):
            found.append(_swap(agent, f"the {REFERENCE} policy", REFERENCE))
    found += swaps_of(replacements or {}, contract, traits.agents)
    found = list({one.name: one for one in found}.values())
    memories = []
    for sharers in traits.resettable:
        steps = tuple(("forgets", agent, "", True) for agent in sharers)
        name = f"resetting {joined_names(sharers)}'s memory"
        memories.append(IdealSubstitute(name, MEMORY, sharers, steps))
    nested = tuple(_nested([*found, *memories], contract))
    return tuple(_forgetting([*nested, *_together(nested)], memories))


def _of_knob(
    name: str, knob: Knob, setup: Setup, contract: Contract, traits: SetupTraits
) -> Iterator[IdealSubstitute]:
    where, agents = knob.of or "argument", traits.agents
    if where == "policy":
        for sharers, given in traits.settings.items():  # one object has one setting
            value = given.get(name, knob.ideal)
            if value != knob.ideal:
                yield _substitute(name, knob, sharers, ("policy", sharers[0], name), value)
        return
    if where == "option":
        values = [(o or {}).get(name, knob.ideal) for o in setup.options]
        if any(value != knob.ideal for value in values):
            yield _substitute(name, knob, tuple(agents), ("option", "", name), values[0])
        return
    arguments = traits.layers if where == "wrapper" else setup.kwargs
    value = arguments.get(name, knob.ideal)
    if not isinstance(value, Mapping) or isinstance(knob.ideal, Mapping):
        if value != knob.ideal:
            yield _substitute(name, knob, tuple(agents), (where, "", name), value)
        return
    for whom, part in value.items():
        theirs = [a for a in members_of(str(whom), agents, contract) if a == whom or a not in value]
        if part != knob.ideal and theirs:
            yield _substitute(name, knob, tuple(theirs), (where, str(whom), name), part)


def _substitute(
    name: str, knob: Knob, agents: tuple[str, ...], step: tuple[str, str, str], value: Any
) -> IdealSubstitute:
    if knob.label == ENVIRONMENT:
        agents = ()
    whom = f"[{', '.join(agents) if step[0] == 'policy' else step[1]}]" if step[1] else ""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    number = float(value) if is_number else None
    steps, shown = ((*step, knob.ideal),), f"{name}{whom} = {knob.ideal}"
    return IdealSubstitute(shown, knob.label, agents, steps, value=number)


def _of_protocol(
    setup: Setup, contract: Contract, agents: Sequence[str]
) -> Iterator[IdealSubstitute]:
    """The declared horizon in place of another one, and no cut before it."""
    declared = contract.schedule.horizon
    given = setup.kwargs.get("horizon")
    steps: list[tuple[str, str, str, Any]] = []
    if declared is not None and given is not None and given < declared:
        steps.append(("argument", "", "horizon", declared))
    if setup.most_turns < MOST_TURNS:
        steps.append(("most_turns", "", "", MOST_TURNS))
    if steps and "horizon" not in contract.knobs:
        yield IdealSubstitute(
            "the declared horizon", EVALUATION, tuple(agents), tuple(steps), cut_off="declared"
        )


def _of_cut_offs(setup: Setup, traits: SetupTraits) -> Iterator[IdealSubstitute]:
    """Other cut-offs, by the environment's own argument that every failed episode ran into."""
    for name, value in traits.cuts.items():
        step = ("argument", "", name, LONGER * value)
        if name in setup.kwargs:
            own, shown = ("argument", "", name, ABSENT), f"{name} at its default"
            yield IdealSubstitute(shown, EVALUATION, (), (own,), cut_off="default")
        yield IdealSubstitute(f"{name} = {LONGER * value}", CUT_OFF, (), (step,), cut_off="later")


def swaps_of(
    replacements: Mapping[str, Any], contract: Contract, agents: Sequence[str]
) -> Iterator[IdealSubstitute]:
    """Policies that a user names in place of agents' own, an agent at a time.

    Args:
        replacements: by agent, by role, or under `*` for every agent of `agents`.
    Raises:
        EvidenceError: a name is no agent and no role.
    """
    for whom, policy in replacements.items():
        members = agents if whom == EVERYBODY else members_of(whom, agents, contract)
        if not members:
            raise EvidenceError(
                f"a policy is to be tried for {whom!r}, which is no agent and no role here",
                where="replace (--try)",
                expected=", ".join(agents),
                actual=whom,
                fix="name an agent or a role of this environment",
            )
        shown = policy if isinstance(policy, str) else type(policy).__name__
        yield from (_swap(agent, f"the policy {shown}", policy) for agent in members)


def peers_of(
    setup: Setup, contract: Contract, agents: Sequence[str], env: object = None
) -> Iterator[IdealSubstitute]:
    """For each agent the policies of others of its role, where they have others; a few each.

    Then each of these in the place of all of the role that have another one. Agents that neither
    contract nor names join with any other are peers where `env` gives them equal spaces.
    """
    groups: dict[tuple[str, str], list[IdealSubstitute]] = {}
    roles = roles_of(contract, agents, env)
    for agent in agents:
        own = setup.policy_of(agent, contract)
        others = {
            peer: setup.policy_of(peer, contract) for peer in agents if roles[peer] == roles[agent]
        }
        unlike = [(peer, x) for peer, x in others.items() if x is not None and x != own]
        for peer, policy in unlike[:PEERS]:
            with contextlib.suppress(Exception):  # foreign code; what can't be copied isn't tried
                one = _swap(agent, f"{peer}'s policy", copy.deepcopy(policy))
                groups.setdefault((roles[agent], peer), []).append(one)
                yield one
    for (_, peer), swaps in groups.items():
        if len(swaps) > 1:
            names = joined_names([one.agents[0] for one in swaps])
            yield joined(swaps, f"giving {names} {peer}'s policy")


def roles_of(contract: Contract, agents: Sequence[str], env: object) -> dict[str, str]:
    """Role of each agent; of one that is alone in its, that of the first such with its spaces."""
    roles = {agent: contract.role_of(agent) or role_in_name(agent) for agent in agents}
    size = Counter(roles.values())
    alone = [each for each in agents if size[roles[each]] == 1 and contract.role_of(each) is None]
    spaces = {each: (observation_space(env, each), action_space(env, each)) for each in alone}
    for agent in (each for each in alone if None not in spaces[each]):
        roles[agent] = next(roles[like] for like in alone if spaces[like] == spaces[agent])
    return roles


def renewals_of(setup: Setup, traits: SetupTraits) -> Iterator[IdealSubstitute]:
    """A fresh object of each policy in every episode, then of two: call it before any was played.

    What a policy's own `reset` doesn't clear is gone with the object.
    """
    given = None
    if not all(isinstance(policy, str) for policy in setup.policies.values()):
        try:
            given = copy.deepcopy(dict(setup.policies))
        except Exception:  # foreign code; what can't be copied isn't tried
            return
    found = []
    for sharers in traits.renewable:
        name = f"playing each episode with a fresh object of {joined_names(sharers)}'s policy"
        steps = tuple(("renews", agent, "", given) for agent in sharers)
        found.append(IdealSubstitute(name, CARRIED, sharers, steps))
    yield from found
    for two in combinations(found, 2) if len(found) <= MOST_RENEWED else ():
        names = joined_names([agent for one in two for agent in one.agents])
        yield joined(two, f"playing each episode with fresh objects of {names}'s policies")


def _swap(agent: str, shown: str, policy: Any) -> IdealSubstitute:
    step = ("policies", agent, "", policy)
    return IdealSubstitute(f"giving {agent} {shown}", POLICY, (agent,), (step,))


def _forgetting(
    found: Iterable[IdealSubstitute], memories: Sequence[IdealSubstitute]
) -> Iterator[IdealSubstitute]:
    """Yields the handles; new policies for all that a memory serves make up for resetting it."""
    for one in found:
        replaced = {step[1] for step in one.steps if step[0] == "policies"}
        names = {memory.name for memory in memories if set(memory.agents) <= replaced}
        yield replace(one, contains=one.contains | names)


def _nested(found: Sequence[IdealSubstitute], contract: Contract) -> Iterator[IdealSubstitute]:
    """The handles with what they are declared to make up for, for the same agents."""
    for one in found:
        knob = contract.knobs.get(one.steps[0][2])
        inner = knob.contains if knob is not None and knob.contains else ()
        within = [other for other in found if set(other.agents) <= set(one.agents)]
        names = {other.name for other in within if other.steps[0][2] in inner}
        yield replace(one, contains=one.contains | names)


def _together(found: Sequence[IdealSubstitute]) -> Iterator[IdealSubstitute]:
    """For each component with several handles, all of them at once."""
    for component in COMPONENTS:
        parts = [one for one in found if one.component == component]
        if component == POLICY:  # an agent has one policy: the first that is tried in its place
            parts = list({one.agents: one for one in parts[::-1]}.values())[::-1]
        if len(parts) > 1:
            whole = f"everything of {component} at once"
            yield joined(parts, " and ".join(briefly(parts)) if component == POLICY else whole)


def briefly(parts: Iterable[IdealSubstitute]) -> list[str]:
    """Names of ideal substitutes; those that give single agents the same are one."""
    found: dict[str, list[str]] = {}
    for part in parts:
        shown = part.name.removeprefix(f"giving {part.agents[0]} ") if part.agents else part.name
        is_merged = len(part.agents) == 1 and shown != part.name
        found.setdefault(shown if is_merged else part.name, []).extend(part.agents[:is_merged])
    return [f"giving {joined_names(who)} {shown}" if who else shown for shown, who in found.items()]


def joined(parts: Sequence[IdealSubstitute], name: str | None = None) -> IdealSubstitute:
    """Several ideal substitutes at once; they are what it contains."""
    agents = dict.fromkeys(agent for part in parts for agent in part.agents)
    inner = {part.name for part in parts} | {name for part in parts for name in part.contains}
    components = dict.fromkeys(part.component for part in parts)
    return IdealSubstitute(
        name or " + ".join(part.name for part in parts),
        " + ".join(components),
        tuple(agents),
        tuple(step for part in parts for step in part.steps),
        frozenset(inner),
        parts=tuple(parts),
    )


def undone(
    undo: BoundaryUndo,
    wider: Iterable[BoundaryUndo] = (),
    between: tuple[str, ...] = (),
    open_as: str = "",
) -> IdealSubstitute:
    """An undo as a substitute; one of several agents makes up for the same one of each.

    Args:
        wider: the undos that may be such of fewer agents.
        between: the speaker and the listeners of the messages that it touches alone.
        open_as: place of the fault in words, where its label stays open.
    """
    alone = [each for each in wider if set(each.agents) < set(undo.agents)]
    inner = {str(each) for each in alone if replace(each, agents=undo.agents) == undo}
    agents = () if undo.component == MESSAGES else undo.agents
    found = IdealSubstitute(str(undo), undo.component, agents, (("undo", "", "", undo),))
    return replace(found, contains=frozenset(inner), between=between, open_as=open_as)


def over_undos(substitutes: Sequence[IdealSubstitute]) -> Iterator[IdealSubstitute]:
    """Yields substitutes; a whole policy makes up for its memory and undos, a memory for lags.

    A cut-off that comes later makes up for anything that is slow, the default one among them. What
    only quickens an agent makes up for a cut-off before the default one.
    """
    quicker = {one.name for one in substitutes if one.is_tuning}
    defaults = {one.name for one in substitutes if one.cut_off == "default"}
    everything = frozenset(one.name for one in substitutes)
    undos = [o for o in substitutes if o.undo is not None or o.component in (MEMORY, CARRIED)]
    for one in substitutes:
        if one.cut_off in ("default", "later"):
            later = {each.name for each in substitutes if each.cut_off == "later"}
            longer = later | quicker if one.cut_off == "default" else set()
            yield replace(one, contains=everything - {one.name} - longer)
            continue
        if one.name in quicker:
            yield replace(one, contains=one.contains | defaults)
            continue
        parts = one.component.split(" + ")
        within = [u for u in undos if set(u.agents) <= set(one.agents)]
        inner = {
            u.name for u in within if POLICY in parts or (MEMORY in parts and u.component == TIMING)
        }
        yield replace(one, contains=one.contains | inner) if inner else one


def weakened(substitute: IdealSubstitute, value: float) -> IdealSubstitute:
    """The ideal substitute of one knob, going only as far as `value`."""
    (where, whom, name, _), *_ = substitute.steps
    return replace(substitute, name=f"{name} at {value:g}", steps=((where, whom, name, value),))


def _applied(setup: Setup, where: str, whom: str, name: str, value: Any) -> Setup:
    if where == "argument" and value is ABSENT:
        return replace(setup, kwargs={key: x for key, x in setup.kwargs.items() if key != name})
    if where in ("argument", "wrapper"):
        given = setup.kwargs if where == "argument" else setup.layers
        new = {**given, name: {**given[name], whom: value} if whom else value}
        return replace(setup, kwargs=new) if where == "argument" else replace(setup, layers=new)
    if where == "option":
        options = tuple({**(each or {}), name: value} for each in setup.options)
        return replace(setup, options=options)
    if where == "policy":
        mine = {**setup.settings.get(whom, {}), name: value}
        return replace(setup, settings={**setup.settings, whom: mine})
    if where == "policies":
        return setup.with_policy(whom, value)
    if where == "renews":
        if value is not None:  # a copy: who isn't renewed is played
            setup = replace(setup, policies=copy.deepcopy(value))
        return replace(setup, renews=(*setup.renews, whom))
    if where == "forgets":
        return replace(setup, forgets=(*setup.forgets, whom))
    if where == "undo":
        return replace(setup, undos=(*setup.undos, value))
    return replace(setup, most_turns=value)


def joined_names(names: Sequence[str]) -> str:
    """Names as `a, b and c`."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
