"""Who plays with whom: every policy by itself, and in every seat with every partner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from gamekeeper.errors import EvidenceError, PolicyError
from gamekeeper.evaluate.look import Look, choices_of
from gamekeeper.evaluate.spec import EVERYONE, MOST_CELLS, Choices, Spec

SELF, ZERO_SHOT, FIXED = "self", "zero-shot", "fixed"
"""Kinds of line-ups: one run in all seats; runs of one method; policies with others."""


@dataclass(frozen=True, slots=True, order=True)
class Side:
    """One checkpoint: a policy by its name, and which of its training runs."""

    policy: str
    run: int = 0


Sides: TypeAlias = "tuple[tuple[str, Side], ...]"


@dataclass(frozen=True, slots=True)
class Pairing:
    """Who sits where.

    Attributes:
        name: as the raw episodes call it: `mappo#0`, or `picker=mappo#0 carrier=random`.
        sides: by seat; of a policy that plays by itself, under `*`.
        choices: the policies by agent, role, or under `*`.
    """

    name: str
    sides: Sides
    choices: Choices

    @property
    def side(self) -> Side | None:
        """The one checkpoint in all seats; None where several meet."""
        found = {side for _, side in self.sides}
        return found.pop() if len(found) == 1 else None

    @property
    def kind(self) -> str:
        """Self-play, partners of the same method, or others."""
        if self.side is not None:
            return SELF
        return ZERO_SHOT if len({side.policy for _, side in self.sides}) == 1 else FIXED

    def side_of(self, agent: str, role: str) -> Side:
        """Who plays an agent."""
        by_seat = dict(self.sides)
        for seat in (agent, role, EVERYONE):
            if seat in by_seat:
                return by_seat[seat]
        raise KeyError(agent)  # seats cover everybody: `seats_of` has seen to it


def by_themselves(spec: Spec, environment: str) -> list[Pairing]:
    """Every policy's every run in all seats."""
    return [
        Pairing(shown(spec, side), ((EVERYONE, side),), choices_of(choices, spec))
        for name, policy in spec.policies.items()
        for run, choices in enumerate(policy.runs_in(environment))
        for side in (Side(name, run),)
    ]


def shown(spec: Spec, side: Side) -> str:
    """A side's name: with the number of its run where it is of a method."""
    return f"{side.policy}#{side.run}" if spec.policies[side.policy].is_method else side.policy


def seats_of(spec: Spec, environment: str, look: Look) -> tuple[str, ...]:
    """The seats of an environment, of which every agent has one.

    Its roles, where there are several; its two agents; or one agent and all others.

    Raises:
        EvidenceError: an agent has no seat, or there is only one.
    """
    asked = spec.crossplay.roles.get(environment, spec.crossplay.roles.get(EVERYONE))
    agents, roles = list(look.roles), list(look.role_names)
    if asked is None:
        several = tuple(roles) if len(roles) > 1 else tuple(agents)
        asked = several if len(several) <= max(len(roles), 2) else (agents[0], EVERYONE)
    known = {*agents, *roles, EVERYONE}
    seatless = [a for a, r in look.roles.items() if not {a, r, EVERYONE} & set(asked)]
    strange = [seat for seat in asked if seat not in known]
    if len(asked) < 2 or strange or seatless:
        raise EvidenceError(
            "the seats of cross-play don't fit the environment",
            where=f"crossplay.roles, {environment}",
            expected=f"at least two of {', '.join([*roles, *agents, EVERYONE])}, for everybody",
            seen=", ".join(asked) or "none",
            mend=f"name a seat for {', '.join(seatless)}, or '*'" if seatless else "",
        )
    return asked


def crossed(spec: Spec, environment: str, look: Look, seats: tuple[str, ...]) -> list[Pairing]:
    """Every policy in every seat with every partner in all other seats; nobody alone.

    Raises:
        EvidenceError: there are more than `MOST_CELLS`.
        PolicyError: a policy says nothing for a seat.
    """
    found: dict[Sides, None] = {}
    for a, b in _meetings(spec, environment):
        for seat in seats:
            sides = tuple((each, a if each == seat else b) for each in seats)
            found.setdefault(sides)
            if len(found) > MOST_CELLS:
                raise EvidenceError(
                    "cross-play has too many line-ups", where=f"crossplay, {environment}",
                    expected=f"at most {MOST_CELLS:,}", seen="more",
                    mend="name fewer [crossplay] partners, or pair each run with a few: sample = 3",
                )  # fmt: skip
    return [_pairing(spec, environment, look, sides) for sides in found]


def _meetings(spec: Spec, environment: str) -> Iterator[tuple[Side, Side]]:
    """Who meets whom, one in a seat and the other in the rest."""
    partners = spec.crossplay.partners or tuple(spec.policies)
    counts = {name: len(each.runs_in(environment)) for name, each in spec.policies.items()}
    for a, of_a in counts.items():
        for b in partners:
            for i, j in _runs(spec, a, b, of_a, counts[b]):
                yield Side(a, i), Side(b, j)


def _runs(spec: Spec, a: str, b: str, of_a: int, of_b: int) -> Iterator[tuple[int, int]]:
    """Which runs of two policies meet; in both directions the same ones."""
    names = list(spec.policies)
    if names.index(a) > names.index(b):
        yield from ((i, j) for j, i in _runs(spec, b, a, of_b, of_a))
        return
    sample = spec.crossplay.sample
    near = set(range(of_b) if sample is None else range(min(sample, of_b)))
    for i in range(of_a):
        for j in range(of_b):
            if a == b:
                apart = min((j - i) % of_b, (i - j) % of_b)  # both ways alike
                if i != j and (sample is None or apart <= sample):
                    yield i, j
            elif (j - i) % of_b in near or (of_a > of_b and (i - j) % of_a in near):
                yield i, j


def _pairing(spec: Spec, environment: str, look: Look, sides: Sides) -> Pairing:
    by_seat = dict(sides)
    choices: dict[str, Any] = {}
    for seat, side in sides:
        table = choices_of(spec.policies[side.policy].runs_in(environment)[side.run], spec)
        roles = look.role_names if seat == EVERYONE else (seat,)
        for role in roles:
            if role in look.roles:  # the seat is an agent
                choices[role] = _choice(table, side, role, look.roles[role])
            elif role not in by_seat or role == seat:
                choices[role] = _choice(table, side, role)
        for agent, role in look.roles.items():
            is_there = role in roles and agent not in by_seat and not (
                seat == EVERYONE and role in by_seat
            )  # fmt: skip
            if is_there and agent in table:
                choices[agent] = table[agent]
    name = " ".join(f"{seat}={shown(spec, side)}" for seat, side in sides)
    return Pairing(name, sides, choices)


def _choice(table: Mapping[str, Any], side: Side, *whom: str) -> Any:
    for each in (*whom, EVERYONE):
        if each in table:
            return table[each]
    raise PolicyError(
        f"policy {side.policy!r} says nothing for {whom[0]!r}",
        where=f"policies.{side.policy}", expected=" or ".join([*whom, "'*'"]),
        seen=", ".join(table),
        mend="name a policy for every role that it is to play in cross-play",
    )  # fmt: skip
