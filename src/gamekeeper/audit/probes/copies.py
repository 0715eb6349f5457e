"""Copies of an environment in mid-play go on beside the original, with the same actions."""

from __future__ import annotations

import copy
import pickle
import random
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from operator import methodcaller
from typing import Any, Final

import numpy as np

from gamekeeper.audit.lab import Called, Lab, Saw
from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.run.episode import Play, actions_of
from gamekeeper.run.handed import is_same, snapshot

SHARE: Final = 0.8
MOMENTS: Final = 8
"""Parts of a play, between which copies are made."""
SHORT: Final = 3
"""Turns that a copy goes on; the one of the middle goes on to the end."""
WAYS: Final[Mapping[str, Callable[[Any], Any]]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}
Told = list[tuple[str, Any, Any]]
"""By and by what was given: what it is, whose, a snapshot."""


def plays(lab: Lab) -> Iterator[Play]:
    """One play, some eight times over; copies are made in its midst."""
    return lab.plays(1, runs=8, most_turns=60)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Copies at several moments of the play; then the copy goes on, then the original.

    Facts:
        `copied`: in one way (the field: `deepcopy`, `pickle`), after the turns `at`: `refused`:
            None, or what was raised where it lets itself not be copied, or where the copy can't be
            stepped; `copy` and `original`: None, or in words what each of them gave otherwise than
            a play of which no copy was made. The fact's turn is the first at which one of them did.
    """
    base = lab.play(play, state=False)
    paper = base.play.actions or ()
    if not paper:
        return
    told, again = _whole(lab, play, paper), _whole(lab, play, paper)
    if len(told) != len(paper) or _parting(told, again) is not None:  # it differs by itself
        return
    for way, duplicate in WAYS.items():
        yield from _copied(lab, play, way, duplicate, paper, told)


def _copied(
    lab: Lab,
    play: Play,
    way: str,
    duplicate: Callable[[Any], Any],
    paper: Sequence[Any],
    told: list[Told],
) -> Iterator[Fact]:
    """Copies made in one way at several moments of one play, up to the first that goes astray."""
    env = lab.env()
    _begin(lab, env, play)
    count = len(paper)
    moments = sorted({count * k // MOMENTS for k in range(1, MOMENTS)})
    _tell(lab, env, paper[: moments[0]])
    for at, until in pairwise((*moments, count)):
        after = count if at == count // 2 else min(at + SHORT, count)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = lab.call(way, duplicate, env)
        fact = _beside(lab, way, (env, made), paper, told, (at, until, after))
        if not _is_wrong(fact):
            yield fact
            continue
        if at != moments[0]:  # an earlier copy may be to blame: once more where there was none
            env = lab.env()
            _begin(lab, env, play)
            _tell(lab, env, paper[:at])
            alone = _beside(
                lab, way, (env, lab.call(way, duplicate, env)), paper, told, (at, count, count)
            )
            if _is_wrong(alone) or fact.value["original"] is None:
                fact = alone
        yield fact
        return


def _is_wrong(fact: Fact) -> bool:
    return any(fact.value[name] for name in ("refused", "copy", "original"))


def _beside(
    lab: Lab,
    way: str,
    pair: tuple[Any, Called],
    paper: Sequence[Any],
    told: list[Told],
    turns: tuple[int, int, int],
) -> Fact:
    """What a copy comes to, and then the original.

    Args:
        turns: at which it was copied, until which the original goes on, and until which the copy.
    """
    env, made = pair
    at, until, after = turns
    value: dict[str, Any] = {"refused": None, "copy": None, "original": None, "at": at}
    if made.failed is not None:
        value["refused"] = f"{made.failed.kind}: {made.failed.text}"
        return lab.fact("copied", value, field=way)
    if not getattr(made.value, "agents", None):  # as EzPickle does: the arguments are kept alone
        value["refused"] = "the copy begins anew: it wants a reset"
        return lab.fact("copied", value, field=way)
    # who draws from the global generators is told so elsewhere: here both go on from one place
    dice = random.getstate(), np.random.get_state()
    ours = _tell(lab, made.value, paper[at:after])
    random.setstate(dice[0])
    np.random.set_state(dice[1])
    theirs = _tell(lab, env, paper[at:until])
    lab.call("close", made.value.close)
    if ours and ours[0][0][0] == "raises" and told[at][0][0] != "raises":
        value["refused"] = f"the copy can't be stepped: {ours[0][0][2]}"
    seen = []
    for name, gave, end in (("copy", ours, after), ("original", theirs, until)):
        parting = _parting(told[at:end], gave)
        if parting is not None and not (name == "copy" and value["refused"]):
            seen.append(at + parting[0] + 1)
            value[name] = f"{parting[1]} at turn {seen[-1]}"
    return lab.fact("copied", value, turn=min(seen, default=None), field=way)


def _whole(lab: Lab, play: Play, paper: Sequence[Any]) -> list[Told]:
    env = lab.env()
    _begin(lab, env, play)
    return _tell(lab, env, paper)


def _begin(lab: Lab, env: Any, play: Play) -> None:
    given = {"seed": play.seed, "options": play.options}
    lab.call("reset", env.reset, **{key: item for key, item in given.items() if item is not None})


def _tell(lab: Lab, env: Any, paper: Sequence[Any]) -> list[Told]:
    """Steps, and tells of each step all that it gave."""
    told = []
    for actions in actions_of(paper):
        told.append(_step(lab, env, dict(actions)))
        if told[-1][0][0] == "raises" or not getattr(env, "agents", None):
            break
    return told


def _step(lab: Lab, env: Any, actions: dict[Any, Any]) -> Told:
    contract = lab.contract
    gave: Told = []
    if lab.api == "aec":
        last = lab.call("last", env.last)
        if last.failed is not None:
            return [("raises", None, f"{last.failed.kind}: {last.failed.text}")]
        agent = getattr(env, "agent_selection", None)
        gave.append(("last()", agent, _quiet(last.value, contract)))
    done = lab.step(env, actions if lab.api == "parallel" else next(iter(actions.values()), None))
    if done.failed is not None:
        return [("raises", None, f"{done.failed.kind}: {done.failed.text}")]
    if lab.api == "aec":
        gave.append(("rewards", None, snapshot(getattr(env, "rewards", None))))
    elif isinstance(done.value, tuple) and len(done.value) == 5:
        names = ("observations", "rewards", "terminations", "truncations")
        pairs = zip(names, done.value, strict=False)
        gave += [(name, None, snapshot(part)) for name, part in pairs]
        infos = done.value[4]
        if isinstance(infos, dict):
            gave.append(("infos", None, {a: _without(i, contract) for a, i in infos.items()}))
    state = lab.call("state", methodcaller("state"), env)
    if state.failed is None:
        gave.append(("state()", None, snapshot(state.value)))
    return gave


def _quiet(last: Any, contract: Contract) -> Any:
    """What `last()` gave, without fields of the info that may differ between equal plays."""
    if not isinstance(last, tuple) or len(last) != 5:
        return snapshot(last)
    return snapshot((*last[:4], _without(last[4], contract)))


def _without(info: Any, contract: Contract) -> Any:
    volatile = contract.volatile_infos()
    if not isinstance(info, dict):
        return snapshot(info)
    return snapshot({key: item for key, item in info.items() if key not in volatile})


def _parting(told: list[Told], other: list[Told]) -> tuple[int, str] | None:
    """The first step that gave something else, and what."""
    for turn, (one, two) in enumerate(zip(told, other, strict=False)):
        for (name, agent, value), (name_2, agent_2, value_2) in zip(one, two, strict=False):
            if name != name_2:
                return turn, str(value_2) if name_2 == "raises" else f"{name} is missing"
            if agent != agent_2 or not is_same_copy(value, value_2):
                return turn, f"{name} differs" if agent == agent_2 else "agent_selection differs"
        if len(one) != len(two):
            return turn, "there is more or less of it"
    if len(told) != len(other):
        return min(len(told), len(other)), "the episode has another length"
    return None


def is_same_copy(one: Any, other: Any) -> bool:
    """Whether two snapshots are the same; objects that can't be copied aren't compared."""
    return is_same(_bare(one), _bare(other))


def _bare(value: Any) -> Any:
    """A snapshot with its objects that couldn't be copied left out."""
    if isinstance(value, dict):
        return {key: _bare(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_bare(item) for item in value]
    return None if type(value).__name__ == "Opaque" else value
