"""Line-ups: every policy by itself, and in every place with every partner."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from gamekeeper.errors import EvidenceError, PolicyError
from gamekeeper.evaluation.inspection import Inspection, choices_of, digest_of, opening_of, portable
from gamekeeper.evaluation.spec import EVERYONE, MOST_CELLS, Choices, Spec
from gamekeeper.evaluation.worker_tasks import PARTS, PLAY
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import WorkTask

SELF, ZERO_SHOT, FIXED = "self", "zero-shot", "fixed"
"""Kinds of line-ups: one run in all positions; runs of one method; policies with others."""


@dataclass(frozen=True, slots=True, order=True)
class Checkpoint:
    """One checkpoint: a policy by its name, and which of its training runs."""

    policy: str
    run: int = 0


Sides: TypeAlias = "tuple[tuple[str, Checkpoint], ...]"


@dataclass(frozen=True, slots=True)
class Pairing:
    """Line-up of one match.

    Attributes:
        name: as the raw episodes call it: `mappo#0`, or `picker=mappo#0 carrier=random`.
        sides: by position; of a policy that plays by itself, under `*`.
        choices: the policies by agent, role, or under `*`.
    """

    name: str
    sides: Sides
    choices: Choices

    @property
    def side(self) -> Checkpoint | None:
        """The one checkpoint in all positions; None where several meet."""
        found = {side for _, side in self.sides}
        return found.pop() if len(found) == 1 else None

    @property
    def kind(self) -> str:
        """Self-play, partners of the same method, or others."""
        if self.side is not None:
            return SELF
        return ZERO_SHOT if len({side.policy for _, side in self.sides}) == 1 else FIXED


def by_themselves(spec: Spec, environment: str) -> list[Pairing]:
    """Every policy's every run in all positions."""
    return [
        Pairing(shown(spec, side), ((EVERYONE, side),), choices_of(choices, spec))
        for name, policy in spec.policies.items()
        for run, choices in enumerate(policy.runs_in(environment))
        for side in (Checkpoint(name, run),)
    ]


def shown(spec: Spec, side: Checkpoint) -> str:
    """A side's name: with the number of its run where it is of a method."""
    return f"{side.policy}#{side.run}" if spec.policies[side.policy].is_method else side.policy


def positions_of(spec: Spec, environment: str, inspection: Inspection) -> tuple[str, ...]:
    """The positions of an environment, of which every agent has one.

    Its roles, where there are several; its two agents; or one agent and all others.

    Raises:
        EvidenceError: an agent has no position, or there is only one.
    """
    asked = spec.crossplay.roles.get(environment, spec.crossplay.roles.get(EVERYONE))
    agents, roles = list(inspection.roles), list(inspection.role_names)
    if asked is None:
        several = tuple(roles) if len(roles) > 1 else tuple(agents)
        asked = several if len(several) <= max(len(roles), 2) else (agents[0], EVERYONE)
    known = {*agents, *roles, EVERYONE}
    unplaced = [a for a, r in inspection.roles.items() if not {a, r, EVERYONE} & set(asked)]
    strange = [position for position in asked if position not in known]
    if len(asked) < 2 or strange or unplaced:
        raise EvidenceError(
            "the positions of cross-play don't fit the environment",
            where=f"crossplay.roles, {environment}",
            expected=f"at least two of {', '.join([*roles, *agents, EVERYONE])}, for everybody",
            actual=", ".join(asked) or "none",
            fix=_positions_fix(unplaced, strange),
        )
    return asked


def _positions_fix(unplaced: Sequence[str], strange: Sequence[str]) -> str:
    if strange:
        return f"take {', '.join(strange)} out, or name a role or an agent of the environment"
    if unplaced:
        return f"name a position for {', '.join(unplaced)}, or '*'"
    return "name one position more; '*' stands for all other agents"


def crossed(
    spec: Spec, environment: str, inspection: Inspection, positions: tuple[str, ...]
) -> list[Pairing]:
    """Every policy in every position with every partner in all other positions; no policy alone.

    Raises:
        EvidenceError: there are more than `MOST_CELLS`.
        PolicyError: a policy names none for a position.
    """
    found: dict[Sides, None] = {}
    for a, b in _meetings(spec, environment):
        for position in positions:
            sides = tuple((each, a if each == position else b) for each in positions)
            found.setdefault(sides)
            if len(found) > MOST_CELLS:
                raise EvidenceError(
                    "cross-play has too many pairings",
                    where=f"crossplay, {environment}",
                    expected=f"at most {MOST_CELLS:,}",
                    actual="more",
                    fix="name fewer [crossplay] partners, or pair each run with a few: sample = 3",
                )
    return [_pairing(spec, environment, inspection, sides) for sides in found]


def _meetings(spec: Spec, environment: str) -> Iterator[tuple[Checkpoint, Checkpoint]]:
    """Pairs of policies that meet, one in a place and the other in the rest."""
    partners = spec.crossplay.partners or tuple(spec.policies)
    counts = {name: len(each.runs_in(environment)) for name, each in spec.policies.items()}
    for a, of_a in counts.items():
        for b in partners:
            for i, j in _runs(spec, a, b, of_a, counts[b]):
                yield Checkpoint(a, i), Checkpoint(b, j)


def _runs(spec: Spec, a: str, b: str, of_a: int, of_b: int) -> Iterator[tuple[int, int]]:
    """Runs of two policies that meet; in both directions the same ones."""
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


def _pairing(spec: Spec, environment: str, inspection: Inspection, sides: Sides) -> Pairing:
    by_position = dict(sides)
    choices: dict[str, Any] = {}
    for position, side in sides:
        table = choices_of(spec.policies[side.policy].runs_in(environment)[side.run], spec)
        roles = inspection.role_names if position == EVERYONE else (position,)
        for role in roles:
            if role in inspection.roles:  # the position is an agent
                choices[role] = _choice(table, side, role, inspection.roles[role])
            elif role not in by_position or role == position:
                choices[role] = _choice(table, side, role)
        for agent, role in inspection.roles.items():
            is_there = (
                role in roles
                and agent not in by_position
                and not (position == EVERYONE and role in by_position)
            )
            if is_there and agent in table:
                choices[agent] = table[agent]
    name = " ".join(f"{position}={shown(spec, side)}" for position, side in sides)
    return Pairing(name, sides, choices)


def _choice(table: Mapping[str, Any], side: Checkpoint, *places: str) -> Any:
    for each in (*places, EVERYONE):
        if each in table:
            return table[each]
    raise PolicyError(
        f"policy {side.policy!r} names no policy for {places[0]!r}",
        where=f"policies.{side.policy}",
        expected=" or ".join([*places, "'*'"]),
        actual=", ".join(table),
        fix="name a policy for every role that it is to play in cross-play",
    )


CHUNK: Final = 20
"""Episodes of a part: another number would give an environment that leaks other results."""


@dataclass(frozen=True, slots=True)
class Match:
    """A line-up in an environment.

    Attributes:
        positions: of cross-play there; empty where there is none.
        arguments: of the playing task, but for the episodes.
        digest: of everything that settles what an episode comes to.
    """

    environment: str
    pairing: Pairing
    positions: tuple[str, ...]
    arguments: Mapping[str, Any]
    digest: str

    def key(self, first: int, last: int) -> str:
        """The name of a part."""
        return f"{self.digest}.{first}-{last}"

    def task(self, first: int, last: int, place: str) -> WorkTask:
        """The task that plays a part into storage."""
        key = self.key(first, last)
        what = {**self.arguments, "first": first, "last": last}
        return WorkTask(key, PLAY, {"place": place, "key": key, **what})


def matches_of(spec: Spec, inspections: Mapping[str, Inspection], *, is_here: bool) -> list[Match]:
    """Every line-up of every environment, in the order of the specification.

    Args:
        is_here: it is played in this process, so that objects needn't be named.
    Raises:
        EvidenceError: there are too many, or a policy is an object that can't leave this process.
        PolicyError: a policy names none for a position.
    """
    found = []
    for name in spec.environments:
        inspection = inspections[name]
        positions: tuple[str, ...] = ()
        pairings = by_themselves(spec, name)
        if spec.crossplay.enabled:
            positions = positions_of(spec, name, inspection)
            pairings += crossed(spec, name, inspection, positions)
        found += [
            _match(spec, name, inspection, each, positions, is_here=is_here) for each in pairings
        ]
    return found


def _match(
    spec: Spec,
    name: str,
    inspection: Inspection,
    pairing: Pairing,
    positions: tuple[str, ...],
    *,
    is_here: bool,
) -> Match:
    environment = spec.environments[name]
    opening: Any = opening_of(environment, spec)
    options: Any = environment.options
    if not is_here:
        opening, options = portable(opening, options)
    sides = {position: [side.policy, side.run] for position, side in pairing.sides}
    part: dict[str, Any] = {
        "label": {"environment": name, "pairing": pairing.name},
        "sides": sides,
        "success": dict(environment.success),
        "infos": list(spec.infos),
    }
    limits = {"seed": spec.seed, "most_turns": environment.most_turns}
    playing = {
        position: inspection.policies[side.policy][side.run] for position, side in pairing.sides
    }
    digest = digest_of(
        [{**part, **limits}, inspection.digest, inspection.version, inspection.contract, playing]
    )
    lineup = {"opening": opening, "choices": dict(pairing.choices), "options": options, **limits}
    return Match(name, pairing, positions, {**part, "lineup": lineup}, digest[:24])


def chunks(first: int, last: int) -> Iterator[tuple[int, int]]:
    """The bounds of the parts that episodes `first` to `last - 1` fall into."""
    for start in range(first, last, CHUNK):
        yield start, min(start + CHUNK, last)


def played_keys(storage: Storage) -> set[str]:
    """The parts that have a receipt."""
    names = storage.names(PARTS) if storage.exists(PARTS) else []
    return {name.removesuffix(".json") for name in names if name.endswith(".json")}
