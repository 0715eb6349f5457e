"""How often the turn that lost an episode is found, and the agent whose action would have kept it.

Episodes come from pivot_tasks.py, whose truth is worked out by plain loops that know nothing of the
search. *Planted*: one action of one agent is replaced by another legal one; it counts where 500
continuations with this action at the turn and 500 without show a fall of success of at least 0.3.
*Own*: failures of the policies themselves whose steepest turn, looked for with 60 continuations
from every turn and measured with 500, falls by as much; the agents that could have kept it are
those with another action that wins back half of the fall (200 continuations each). On the task
`certain` nothing is drawn; there the truth is the last turn from which another action of one agent
succeeds, by exhaustive search.

The turn is right where a pivot of the answer lies within one turn of the truth; the agent where the
pivot names are all true ones, the planted one among them, or none where there is none. Prints a
JSON line for each episode (also into `--keep`, from which a second call goes on), then the shares
with Wilson intervals, and seconds an episode on `warehouse`.

    python benchmarks/pivots.py [--planted 10] [--own 10] [--warehouse 2] [--budget 60000]
        [--keep pivots.jsonl] [--task NAME]

With `--copies` it prints in place of all that the part of pivots' time that is spent on copies of
policies, for PPO models of Stable-Baselines3 with two sizes of networks, on `ferry`:

    .venv-sb3/bin/python benchmarks/pivots.py --copies
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from itertools import count, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import Env

sys.path.insert(0, str(Path(__file__).parent))

from pivot_tasks import TASKS, WAREHOUSE, Actions, Plain, Task

import gamekeeper as gk
from gamekeeper.contract.failure import Failure
from gamekeeper.episodes.outcome import TEAM, failed, outcome_of
from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.statistics.significance import wilson

SEED = 20_250
FALL = 0.3
QUICK, MANY, EACH = 60, 500, 200
BATCH = 40
"""Episodes that are recorded at once, to find some that failed."""


class Blunder:
    """A task's policy that once an episode takes another action in place of an agent's."""

    def __init__(self, task: Task) -> None:
        self.task, self.done, self.now = task, [], 0

    def reset(self, seed: int) -> None:
        """Begins an episode: draws the call and the action."""
        rng = np.random.default_rng(seed)
        self.call = int(rng.integers(2, 60 if self.task.name == "handover" else 14))
        self.pick, self.now = int(rng.integers(100)), 0
        self.done.append((self.call, None))

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """Returns an action."""
        action = self.task.policy(observation, agent, info, rng)
        self.now += 1
        if self.now - 1 != self.call:
            return action
        self.done[-1] = self.call, str(agent)
        if isinstance(action, np.ndarray):
            return np.full_like(action, 2.0 if action.sum() < 0 else -2.0)
        mask = info.get("action_mask")
        if mask is None and isinstance(observation, dict):
            mask = observation.get("action_mask")
        legal = np.arange(3) if mask is None else np.flatnonzero(mask)
        others = [int(each) for each in legal if each != action]
        return others[self.pick % len(others)] if others else action


def recorded(evidence: gk.Evidence, episode: int, env: Any) -> tuple[int, list[Actions]]:
    """Seed and actions of an episode."""
    episode = evidence.episode(episode)
    known = {str(agent): agent for agent in env.possible_agents}
    turns = [turn for turn in episode.turns if turn.order]
    return episode.seed, [{known[a]: turn.actions.get(a) for a in turn.order} for turn in turns]


def failing(task: Task, policy: Any, seed: int, episodes: int = 1) -> tuple[gk.Evidence, list[int]]:
    """Episodes of a policy, and the numbers of those that failed."""
    evidence = gk.rollout(
        task.spec, policies=policy, episodes=episodes, seed=seed, env_kwargs=dict(task.kwargs)
    )
    condition = {TEAM: Failure(task.failed)}
    told = [failed(outcome_of(each), condition, evidence.contract) for each in evidence.episodes]
    return evidence, [k for k, each in enumerate(told) if each[TEAM]]


Found = Iterator[tuple[gk.Evidence, int, dict[str, Any]]]


def planted(task: Task) -> Found:
    """Episodes with a planted blunder, and their truth."""
    plain = Plain(task)
    for number in count():
        policy = Blunder(task)
        evidence, episodes = failing(task, policy, SEED + number, BATCH)
        for episode in episodes:
            call, agent = policy.done[episode]
            if agent is None:
                continue
            seed, actions = recorded(evidence, episode, plain.env)
            turn = call if len(actions[0]) == 1 else call // len(actions[0])
            if _fall(plain, seed, actions, turn, QUICK) < FALL - 0.1:
                continue
            fall = plain.share(seed, actions, turn, MANY)
            fall -= plain.share(seed, actions, turn, MANY, dict(actions[turn]))
            agents = _keepers(plain, seed, actions, turn, fall) if fall >= FALL else []
            if agent in agents:
                yield evidence, episode, _truth(turn, agents, number, planted=agent, fall=fall)


def own(task: Task) -> Found:
    """Failures of the policy itself, and their truth."""
    plain = Plain(task)
    for number in count():
        evidence, episodes = failing(task, task.policy, SEED + 10_000 + number, BATCH)
        for episode in episodes:
            seed, actions = recorded(evidence, episode, plain.env)
            curve = [plain.share(seed, actions, t, QUICK) for t in range(len(actions))]
            falls = [a - b for a, b in pairwise([*curve, 0.0])]
            tops = sorted(range(len(falls)), key=lambda t: -falls[t])[:2]
            exact = {t: _fall(plain, seed, actions, t, MANY) for t in tops}
            turn = max(exact, key=exact.__getitem__)
            if exact[turn] >= FALL:
                agents = _keepers(plain, seed, actions, turn, exact[turn])
                yield evidence, episode, _truth(turn, agents, number, fall=exact[turn])


def _truth(turn: int, agents: list[str], number: int, **more: Any) -> dict[str, Any]:
    return {"turn": turn, "agents": agents, "number": number, **more}


def certain(task: Task) -> Found:
    """Failures where nothing is drawn: other first moves lead to other games."""
    plain, rng, number = Plain(task), np.random.default_rng(SEED), 0
    while True:
        number += 1
        policy = Salted(int(rng.integers(1 << 30)))
        plain.task = Task(**{**vars(task), "policy": policy})
        evidence, episodes = failing(plain.task, policy, SEED + number)
        if not episodes:
            continue
        seed, actions = recorded(evidence, 0, plain.env)
        for turn in reversed(range(len(actions))):
            legal = [(a, x) for a, x in plain.others(actions[turn]) if _is_free(actions, turn, x)]
            keep = {str(a) for a, x in legal if plain.succeeds(seed, actions, turn, 1, {a: x})}
            if keep:
                yield evidence, 0, {"turn": turn, "agents": sorted(keep), "policy": policy}
                break


class Salted:
    """A policy that draws nothing: the board and a number of its own settle what it plays."""

    def __init__(self, salt: int) -> None:
        self.salt = salt

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        """Returns an action."""
        legal = np.flatnonzero(observation["action_mask"])
        weights = np.random.default_rng(self.salt).integers(1_000, size=18)
        return int(
            legal[int(observation["observation"].ravel().astype(int) @ weights) % len(legal)]
        )


def _is_free(actions: list[Actions], turn: int, cell: int) -> bool:
    return all(cell not in before.values() for before in actions[:turn])


def _fall(plain: Plain, seed: int, actions: list[Actions], turn: int, looks: int) -> float:
    after = 0.0 if turn + 1 >= len(actions) else plain.share(seed, actions, turn + 1, looks)
    return plain.share(seed, actions, turn, looks) - after


def _keepers(plain: Plain, seed: int, actions: list[Actions], turn: int, fall: float) -> list[str]:
    """Agents with another action that wins half of the fall back; none where chance lost it."""
    held = plain.share(seed, actions, turn, EACH, dict(actions[turn]))
    after = 0.0 if turn + 1 >= len(actions) else plain.share(seed, actions, turn + 1, EACH)
    if held - after >= fall / 2:
        return []
    found = set()
    for agent, action in plain.others(actions[turn]):
        if str(agent) in found or not _is_legal(plain, seed, actions, turn, agent, action):
            continue
        acts = {**actions[turn], agent: action}
        if plain.share(seed, actions, turn, EACH, acts) - held >= fall / 2:
            found.add(str(agent))
    return sorted(found)


def _is_legal(
    plain: Plain, seed: int, actions: list[Actions], turn: int, agent: Any, action: Any
) -> bool:
    """Looks into the mask that the agent is given at the turn."""
    env = plain.env
    out = env.reset(seed=seed)
    for acts in actions[:turn]:
        out = env.step(
            acts if hasattr(env, "num_agents") and out is not None else acts[env.agent_selection]
        )
    if out is not None:
        return True
    observation, _, _, _, info = env.last()
    mask = info.get("action_mask")
    if mask is None and isinstance(observation, dict):
        mask = observation.get("action_mask")
    return mask is None or bool(mask[action])


def judged(
    task: Task, evidence: gk.Evidence, episode: int, truth: dict[str, Any], budget: int
) -> dict[str, Any]:
    """The answer beside the truth."""
    policy = truth.pop("policy", task.policy)
    began, cpu = time.perf_counter(), time.process_time()
    found = gk.pivots(evidence, episode, failed=task.failed, policies={"*": policy}, budget=budget)
    seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    each = found.episodes[0]
    near = [pivot for pivot in each.pivots if abs(pivot.turn - truth["turn"]) <= 1]
    named = set(near[0].agents) if near and near[0].loss == "action" else set()
    true = set(truth["agents"])
    is_agent = bool(near) and named <= true and bool(named) == bool(true)
    is_agent = is_agent and truth.get("planted", "") in {"", *named}
    return {
        **truth,
        "turns": each.turns,
        "question": each.question,
        "found": [[p.turn, list(p.agents), p.loss, round(p.fall, 2)] for p in each.pivots],
        "right_turn": bool(near),
        "first_turn": bool(near) and near[0] is each.pivots[0],
        "right_agent": is_agent,
        "steps": each.steps,
        "not_tried": list(each.not_tried),
        "seconds": round(seconds, 2),
        "cpu_seconds": round(cpu, 2),
    }


def shown(rows: list[dict[str, Any]], kind: str) -> None:
    """Prints shares of a kind of episodes."""
    mine = [row for row in rows if row["kind"] == kind]
    for key in ("right_turn", "first_turn", "right_agent"):
        share = wilson(sum(row[key] for row in mine), len(mine))
        print(
            f"{kind:8} {key:12} {sum(row[key] for row in mine)} of {len(mine)}: {share.p:.0%} "
            f"({share.low:.0%} to {share.high:.0%})"
        )


def warehouse_seconds(wanted: int, budget: int) -> None:
    """Prints seconds an episode on `warehouse`, for failures of a noisy reference policy."""
    done = number = 0
    while done < wanted:
        number += 1
        evidence, episodes = failing(WAREHOUSE, WAREHOUSE.policy, SEED + number)
        if not episodes:
            continue
        done += 1
        row = judged(WAREHOUSE, evidence, 0, _truth(-9, [], number), budget)
        print(json.dumps({"kind": "warehouse", **row}), flush=True)


LAYERS = ([64, 64], [1024, 1024, 1024])


class Idle(Env[Any, Any]):
    """An environment with a task's spaces, for a model that doesn't learn."""

    def __init__(self, env: Any) -> None:
        agent = env.possible_agents[0]
        self.observation_space = env.observation_space(agent)
        self.action_space = env.action_space(agent)


def copying_seconds(task: Task) -> None:
    """Prints seconds of pivots, and those of them that copies of policies take, by network."""
    import torch
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    torch.set_num_threads(1)
    copied, spent = JointPolicy.__deepcopy__, list[float]()

    def timed(self: JointPolicy, memo: Any) -> JointPolicy:
        began = time.process_time()
        found = copied(self, memo)
        spent.append(time.process_time() - began)
        return found

    JointPolicy.__deepcopy__ = timed  # type: ignore[method-assign]
    for layers in LAYERS:
        idle = Idle(gk.make(task.spec, **task.kwargs))
        model = PPO("MlpPolicy", idle, policy_kwargs={"net_arch": layers}, device="cpu", seed=0)
        policy = sb3.policy(model, deterministic=False)
        evidence, episodes = failing(task, policy, SEED, 5)
        spent.clear()
        row = judged(task, evidence, episodes[0], _truth(-9, [], 0, policy=policy), 2_000)
        row = {key: row[key] for key in ("steps", "cpu_seconds")}
        copies = {"copies": len(spent), "copying_seconds": round(sum(spent), 2)}
        print(json.dumps({"measure": "copies of policies", "layers": layers, **row, **copies}))


def main() -> None:
    """Plays what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--copies", action="store_true", help="what copies of policies cost")
    parser.add_argument("--planted", type=int, default=10, help="episodes of each task")
    parser.add_argument("--own", type=int, default=10, help="episodes of each task")
    parser.add_argument("--warehouse", type=int, default=2)
    parser.add_argument("--budget", type=int, default=60_000)
    parser.add_argument("--keep", type=Path, default=Path("pivots.jsonl"))
    parser.add_argument("--task", choices=TASKS)
    options = parser.parse_args()
    if options.copies:
        copying_seconds(TASKS["ferry"])
        return
    rows = []
    if options.keep.exists():
        rows = [json.loads(line) for line in options.keep.read_text().splitlines()]
    for name, task in TASKS.items():
        if options.task not in (None, name):
            continue
        kinds = [("planted", options.planted, planted), ("own", options.own, own)]
        if task.is_certain:
            kinds = [("own", options.own, certain)]
        for kind, wanted, source in kinds:
            known = sum(row["task"] == name and row["kind"] == kind for row in rows)
            for place, found in enumerate(islice(source(task), wanted)):
                if place < known:
                    continue
                row = {"task": name, "kind": kind, **judged(task, *found, options.budget)}
                rows.append(row)
                print(json.dumps(row), flush=True)
                with options.keep.open("a") as file:
                    file.write(json.dumps(row) + "\n")
    for kind in ("planted", "own"):
        shown(rows, kind)
    warehouse_seconds(options.warehouse, options.budget)


if __name__ == "__main__":
    main()
