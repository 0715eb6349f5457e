"""Reruns of a recorded episode, as it was or with exactly one intervention, and their shrinking."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.episodes.known_extent import env_steps
from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import EvidenceError, PolicyError
from gamekeeper.interface.aec_capture import AECCapture
from gamekeeper.interface.openings import Opening
from gamekeeper.interface.parallel_capture import ParallelCapture
from gamekeeper.rollouts.episode_loop import ActionChooser, Actions, EpisodePlan, step_chosen

# -- The only experiment: play an episode again, as it was or with exactly one thing done
# differently

_SCALAR: Final = re.compile(r"numpy\.((?:u?int|float)\d+|bool|bool_)")


def play_of(episode: Episode, env: Any, types: Mapping[str, str] | None = None) -> EpisodePlan:
    """The episode as a script: seed, options, actions turn by turn, agents as `env` knows.

    Args:
        types: of whole-number actions by agent, for an episode that doesn't name them.
    """
    known = {agent_name(agent): agent for agent in getattr(env, "possible_agents", ())}
    types, played = episode.action_types or types or {}, env_steps(episode)
    actions = tuple(
        {known.get(name, name): _action(turn, name, types) for name in turn.order}
        for turn in episode.turns
        if turn.index < played
    )
    cut = [turn for turn in episode.turns if turn.index >= played]
    return EpisodePlan(
        asks_last=any(_was_seen(turn, name, episode) for turn in cut for name in turn.agents),
        seed=episode.seed,
        stream=episode.episode,
        actions=actions,
        most_turns=max(len(actions), 1),
        options=episode.options,
        opening=episode.header.get("opening"),
    )


def replayed_episode(
    episode: Episode,
    capture: ParallelCapture | AECCapture,
    *,
    agents: Mapping[str, Any],
    types: Mapping[str, str] | None = None,
    joint_policy: ActionChooser | None = None,
    run_seed: int | None = None,
    after_turn: Callable[[], None] | None = None,
    turns: Iterable[Turn] | None = None,
) -> None:
    """Plays `episode` again in `capture`: its reset, its actions in their order.

    An environment that raises where it raised before is taken at its word and played on; one that
    raises elsewhere ends the episode as failed. Whether the rows came out the same is for a
    comparison to say.

    Args:
        agents: the environment's own identity of each agent by its name in the evidence.
        types: of whole-number actions by agent, for an episode that doesn't name them.
        joint_policy: policies that choose in place of the recorded actions (the loop is closed);
            open if None.
        run_seed: seeds the policies of a closed loop.
        turns: of the episode, where `episode` holds only the first of them; it names their number.
    """
    if joint_policy is not None and run_seed is not None:
        joint_policy.begin(run_seed, episode.episode)
    played, types = env_steps(episode), episode.action_types or types or {}
    opening = Opening.from_text(episode.header.get("opening"))
    opening.begin(capture.env, was_reset=capture.was_reset)
    try:
        capture.reset(episode.seed, episode.options)
    except KeyboardInterrupt:
        raise
    except BaseException:  # it ended there as failed, and perhaps it did so before
        return
    for turn in episode.turns if turns is None else turns:
        if turn.index >= played or not capture.env.agents:
            _ask_last(capture, episode, turn)
            break
        if joint_policy is not None and not capture.to_move:
            break
        opening.set_at(turn.index, capture.env)
        try:
            if joint_policy is None:
                _step(capture, episode, turn, agents=agents, types=types)
            else:
                step_chosen(capture, joint_policy)
        except (PolicyError, EvidenceError, KeyboardInterrupt):  # not the environment's
            raise
        except BaseException:  # the rows tell; only a recorded raise is played on from
            if not turn.raised:
                break
        if after_turn is not None:
            after_turn()
    capture.end_episode()


def _step(
    capture: ParallelCapture | AECCapture,
    episode: Episode,
    turn: Turn,
    *,
    agents: Mapping[str, Any],
    types: Mapping[str, str],
) -> None:
    """Plays one turn as it was recorded."""
    done = {name: _action(turn, name, types) for name in turn.order}
    if isinstance(capture, ParallelCapture):
        capture.step({_agent(capture, agents, name): action for name, action in done.items()})
        return
    name = turn.order[0]
    if _was_seen(turn, name, episode):
        capture.last()
    capture.step(done[name])


def _agent(capture: ParallelCapture | AECCapture, agents: Mapping[str, Any], name: str) -> Any:
    """Agent of this name: one of `agents`, or one that joined since; else the name itself."""
    if name in agents:
        return agents[name]
    return next((agent for agent in capture.env.agents if agent_name(agent) == name), name)


def _ask_last(capture: ParallelCapture | AECCapture, episode: Episode, turn: Turn) -> None:
    """An AEC episode may end with a look that no action followed; its row has the observation."""
    if not isinstance(capture, AECCapture) or not capture.env.agents:
        return
    if any(_was_seen(turn, name, episode) for name in turn.agents):
        try:
            capture.last()
        except KeyboardInterrupt:
            raise
        except BaseException:
            return  # then the row that was recorded is missing, and the comparison says so


def _was_seen(turn: Turn, name: str, episode: Episode) -> bool:
    """Tells whether the agent's observation was read before it acted, by the evidence.

    Level "actions" keeps just that. At level "digest" observations aren't kept, and an agent that
    was given anything counts as having looked: so does every loop but one that asks
    `last(observe=False)`.
    """
    if episode.is_actions:
        return name in turn.agents and bool(episode.column("observed")[turn.row(name)])
    return turn.has_observation(name) or (episode.is_digest and name in turn.cumulative_reward)


def _action(turn: Turn, name: str, types: Mapping[str, str]) -> Any:
    """The recorded action, of the very type that was handed over."""
    action = turn.actions.get(name)
    nonconforming = turn.nonconforming.get(name, {}).get("action")
    kind = types.get(name) if nonconforming is None else nonconforming.get("type")
    if action is None or kind is None:
        return action
    if kind == "int":
        return int(action)
    scalar = _SCALAR.fullmatch(kind)
    if scalar is not None and isinstance(action, bool | int | float | np.generic):
        return np.dtype(scalar[1].rstrip("_")).type(action)
    return action


# -- Shrinking: the shortest play that still shows something
#
# Source: Zeller & Hildebrandt 2002, "Simplifying and isolating failure-inducing input" (ddmin),
# with turns as the pieces.

Still = Callable[[EpisodePlan], bool]
"""Test whether a shorter episode shows it too; one that can't be played doesn't."""


def shrink(
    play: EpisodePlan,
    still: Still,
    *,
    turns: int | None = None,
    plain: Mapping[Any, Any] | None = None,
) -> EpisodePlan:
    """The shortest play found that `still` shows it; the episode itself where nothing shorter does.

    First the tail goes, then all actions become plain ones where that shows it, then turns in
    between go, then single actions become plain. A live agent whose action went with its turn takes
    a plain one, else its first, as `stand_ins` of the episode say.
    `still` is asked as long as it answers; whoever has had enough answers no.

    Args:
        play: has a script and shows it.
        turns: it is known to show after so many.
        plain: a simple action for each agent.
    """
    if play.actions is None:
        return play
    actions = play.actions
    play = replace(play, stand_ins={**_first_actions(actions), **(plain or {})})
    if turns is not None and turns < len(actions):
        cut = _with(play, actions[:turns])
        play = cut if still(cut) else play
    simple = _with(play, _simple(play, plain or {}))
    if plain and still(simple):
        return _without_turns(simple, still)
    return _plainer(_without_turns(play, still), still, plain or {})


def _first_actions(turns: Iterable[Actions]) -> dict[Any, Any]:
    found: dict[Any, Any] = {}
    for turn in turns:
        found = {**turn, **found}
    return found


def _with(play: EpisodePlan, actions: tuple[Actions, ...]) -> EpisodePlan:
    return replace(play, actions=actions, most_turns=max(len(actions), 1))


def _without_turns(play: EpisodePlan, still: Still) -> EpisodePlan:
    """Leaves out runs of turns, long ones first; of equal turns it is the same which go."""
    actions = play.actions or ()
    are_equal = all(map(_is_same, actions, actions[1:]))
    size = max(len(actions) // 2, 1) if actions else 0
    while size:
        start = 0
        while start < len(actions):
            shorter = actions[:start] + actions[start + size :]
            if still(_with(play, shorter)):
                actions = shorter
            else:
                start += len(actions) if are_equal else size
        size //= 2
    return _with(play, actions)


def _is_same(one: Actions, other: Actions) -> bool:
    """Tells whether two turns hold the very same actions."""
    return one.keys() == other.keys() and all(one[agent] is other[agent] for agent in one)


def _simple(play: EpisodePlan, plain: Mapping[Any, Any]) -> tuple[Actions, ...]:
    """The turns with a plain action in place of each but those of the ended."""
    return tuple(
        {agent: a if a is None else plain.get(agent, a) for agent, a in each.items()}
        for each in play.actions or ()
    )


def _plainer(play: EpisodePlan, still: Still, plain: Mapping[Any, Any]) -> EpisodePlan:
    """Plain actions in place of drawn ones: everywhere at once, else turn by turn."""
    actions, simple = list(play.actions or ()), _simple(play, plain)
    whole = _with(play, simple)
    if len(simple) and still(whole):
        return whole
    for place, each in enumerate(simple):
        tried = [*actions[:place], each, *actions[place + 1 :]]
        if still(_with(play, tuple(tried))):
            actions = tried
    return _with(play, tuple(actions))
