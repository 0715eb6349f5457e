"""What is handed over: does the environment write into it, or read it again later?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.run.changes.actions_overwritten import ActionsOverwritten
from gamekeeper.run.episode import Play
from gamekeeper.run.handed import is_same, snapshot

SHARE: Final = 0.6


def plays(lab: Lab) -> Iterator[Play]:
    """One play, four times over."""
    return lab.plays(1, runs=4, most_turns=200)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Plays, plays again with actions that are compared after the step, and with overwritten ones.

    Facts:
        `handed`: actions after each step, beside what they were before: `looks`, and `changed`:
            None, or of the first that changed the `agent` (None: the dictionary itself), what it
            was `before` and what it is `after`; field `actions`.
        `options`: what was handed to reset as options, the same way; field `options`.
    Twins:
        with the change `ActionsOverwritten`, where actions are more than plain numbers.
    """
    base = lab.play(play, state=False)
    actions = [dict(each) for each in base.play.actions or ()]
    can_change = lab.api == "parallel" or any(map(_is_writable, actions))
    yield from _options(lab, play)
    if can_change and actions and base.failed is None:
        yield _compared(lab, play, actions)
        sham = lab.play(base.play, state=False)
        yield lab.twin(base, sham, ActionsOverwritten(), state=False)


def _is_writable(actions: Mapping[Any, Any]) -> bool:
    """Whether an action is an object that could be written into."""
    plain = bool | int | float | str | bytes
    return any(
        each is not None and not isinstance(each, plain) and hasattr(each, "__setitem__")
        for each in actions.values()
    )


def _entry(agent: Any, before: Any, after: Any) -> dict[str, Any]:
    return {"agent": agent, "before": before, "after": after}


def _compared(lab: Lab, play: Play, paper: list[dict[Any, Any]]) -> Saw:
    """Steps with actions of its own and compares them after each step."""
    env = lab.env()
    looks, changed = 0, None
    lab.call("reset", env.reset, **_reset(play))
    for each in paper:
        own = {agent: _again(action) for agent, action in each.items()}
        handed: Any = own
        if lab.api == "aec":
            if not env.agents:
                break
            lab.call("last", env.last)
            handed = next(iter(own.values()), None)
        before = snapshot(each)
        stepped = lab.step(env, handed)
        looks += 1
        changed = _first_changed(own, before)
        if changed is not None or stepped.failed is not None:
            break
    agent = None if changed is None else changed["agent"]
    value = {"looks": looks, "changed": changed}
    seen_at = None if changed is None else looks - 1
    return lab.fact("handed", value, turn=seen_at, agent=agent, field="actions")


def _reset(play: Play) -> dict[str, Any]:
    given = {"seed": play.seed, "options": play.options}
    return {name: value for name, value in given.items() if value is not None}


def _again(action: Any) -> Any:
    """A copy that can be written to; a plain value is itself."""
    copy = getattr(action, "copy", None)
    return copy() if callable(copy) and hasattr(action, "__setitem__") else action


def _first_changed(own: dict[Any, Any], before: dict[Any, Any]) -> dict[str, Any] | None:
    if own.keys() != before.keys():
        return _entry(None, sorted(map(str, before)), sorted(map(str, own)))
    for agent, action in own.items():
        if not is_same(action, before[agent]):
            return _entry(agent, before[agent], snapshot(action))
    return None


def _options(lab: Lab, play: Play) -> Iterator[Saw]:
    """Resets with options: empty ones, which every environment must bear."""
    options: dict[str, Any] = dict(play.options or {})
    before = snapshot(options)
    env = lab.env()
    done = lab.call("reset", env.reset, seed=play.seed, options=options)
    if done.failed is None:
        changed = None if is_same(options, before) else _entry(None, before, snapshot(options))
        yield lab.fact("options", {"looks": 1, "changed": changed}, turn=0, field="options")
