"""Resets with several seeds beside resets without one: where do they lead?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from hashlib import blake2b
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.audit.played_twice import told
from gamekeeper.core.canon import to_json
from gamekeeper.core.divergence import compare
from gamekeeper.core.layout import agent_name
from gamekeeper.core.trace import digests_of
from gamekeeper.game.capture.stillness import is_same_state
from gamekeeper.run.changes.generators_elsewhere import GeneratorsElsewhere
from gamekeeper.run.episode import Play, Played, Watch
from gamekeeper.run.reseed import standing

SHARE: Final = 0.5
FEW: Final = 4
"""Plays of a kind, unless something is suspicious."""
MANY: Final = 16
"""Plays of a kind, where one kind varies and the other doesn't."""
MOST_TURNS: Final = 25
SEEDS: Final = 3
"""Of plays that may be longer, where none has made a difference so far."""
LONG: Final = 100
GLOBAL: Final = 2
"""The first places are those of Python's and NumPy's generators, of which other probes see."""
ELSEWHERE: Final = 7_919
"""Any number that nobody is likely to seed with."""


def plays(lab: Lab) -> Iterator[Play]:
    """A short one: what is drawn at the reset shows at once."""
    return lab.plays(1, runs=8, most_turns=MOST_TURNS)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """What plays came to, as digests.

    Facts:
        `seeded`: of seeds in a row, each in a fresh instance where there is one.
        `unseeded`: of resets without a seed that follow on one with, in one instance.
        `openings`: of resets without a seed and without a step in between; only where all seeded
            ones are equal and unseeded ones aren't.
        `elsewhere`: only where all are equal: in words how the play goes where the generators
            stand elsewhere in their streams that every reset begins at one place, whatever the
            seed; None where it is the same play.
    """
    seeded = [_told(lab.play(play, lab.env(), hold=False))]
    _until_two(seeded, FEW, lambda: _told(_seeded(lab, play, len(seeded))))
    env = lab.env()
    lab.play(replace(play, actions=lab.base.actions if lab.base else None), env, hold=False)
    unseeded: list[str] = []
    again = replace(play, seed=None)
    _until_two(unseeded, FEW, lambda: _told(lab.play(again, env, hold=False)))
    kinds = len(set(seeded)), len(set(unseeded))
    if kinds[0] > 1 and kinds[1] == 1:
        while len(seeded) < MANY:
            seeded.append(_told(_seeded(lab, play, len(seeded))))
        while len(unseeded) < MANY and len(set(unseeded)) == 1:
            unseeded.append(_told(lab.play(again, env, hold=False)))
    elif kinds[0] == 1 and kinds[1] > 1:
        _until_two(seeded, MANY, lambda: _told(_seeded(lab, play, len(seeded))))
        yield lab.fact("openings", _openings(lab, lab.env()))
    elif kinds == (1, 1):
        yield lab.fact("elsewhere", _elsewhere(lab, play))
    yield lab.fact("seeded", seeded)
    yield lab.fact("unseeded", unseeded)


def _until_two(found: list[str], most: int, more: Any) -> None:
    """Goes on until two differ."""
    while len(found) < most and len(set(found)) < 2:
        found.append(more())


def _seeded(lab: Lab, play: Play, number: int) -> Played:
    return lab.play(replace(play, seed=(play.seed or 0) + number), lab.env(), hold=False)


def _told(played: Played) -> str:
    """All that was given and done, and nothing of how it came about."""
    trace = played.trace
    text = blake2b(digests_of(trace.steps).tobytes(), digest_size=8)
    for info in trace.steps["info"].to_pylist():
        text.update(str(info).encode())
    return text.hexdigest()


def _elsewhere(lab: Lab, play: Play) -> str | None:
    """How a play goes on from elsewhere in the streams that don't hang on the seed.

    A game without chance draws from nothing, or what it draws makes no difference.
    """
    if play.actions is None:
        play = replace(play, most_turns=max(play.most_turns, min(lab.ration // SEEDS, LONG)))
    played, begun = [], []
    for number in range(SEEDS):
        stands: list[Any] = []
        again = replace(play, seed=(play.seed or 0) + number)
        played.append(lab.play(again, lab.env(), watch=_noting(stands), hold=False))
        begun.append(stands)
    if len(set(map(_told, played))) > 1:
        return None  # later on they part
    places = [
        place
        for place, stand in enumerate(zip(*begun, strict=False))
        if place >= GLOBAL and all(is_same_state(stand[0], each) for each in stand[1:])
    ]
    change = GeneratorsElsewhere(tuple(places), number=ELSEWHERE)
    other = lab.play(played[0].play, lab.env(), change=change, hold=False)
    volatile = lab.contract.volatile_infos()
    found = compare(played[0].trace, other.trace, volatile=volatile).divergence
    return None if found is None else told(found)


def _noting(stands: list[Any]) -> Watch:
    """Notes where the generators stand after the reset."""

    def watch(turn: int, env: Any, out: Any) -> None:
        if turn == 0:
            stands.extend(standing(env))

    return watch


def _openings(lab: Lab, env: Any) -> list[str]:
    found = []
    for _ in range(FEW):
        lab.meter.count()
        out = lab.call("reset", env.reset)
        if out.failed is not None:
            break
        seen = out.value[0] if lab.api == "parallel" else _observed(lab, env)
        found.append(to_json(list(seen.values()) if isinstance(seen, dict) else seen))
    return found


def _observed(lab: Lab, env: Any) -> dict[str, Any]:
    return {
        agent_name(agent): lab.call("observe", env.observe, agent).value for agent in env.agents
    }
