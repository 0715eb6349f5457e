"""One PPO of Tianshou 2 learns tic-tac-toe against itself, from both sides of the board.

Needs Tianshou (`pip install 'gamekeeper[tianshou,fast]'`); one thread, no GPU:

    python examples/tianshou_tictactoe.py --seed 0

It is a game of turns, in which who loses is paid while the other moves. Each player's decisions
stand in a sub-buffer of their own, with what they were paid until it moved again or the game was
over; so any algorithm of Tianshou's learns from them as from a single agent's. What a player sees
is told from its own side, so both can share a network.

The shared network and much entropy (`ent_coef`) are what makes it play well against others than
itself: without either, both sides soon know a few games by heart and hardly any other board.

The last line is JSON: points of what was learnt against random players, as either player, in games
that nobody learnt from; a draw is half a point. Half-way the algorithm is saved, and a new one goes
on from the file; `gk.rollout` plays the last file's games, which are recorded and replayed.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import DiscreteActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import VectorReplayBuffer
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.discrete import DiscreteActor, DiscreteCritic

import gamekeeper as gk
from gamekeeper.adapters import tianshou as adapter
from gamekeeper.statistics.one_sample import one_sample

TASK: Final = "tictactoe"
WANTED: Final = 0.85
"""Points in a game; of two random players who change places each has 0.5."""
UNSEEN: Final = 1_000_000


def player(env: Any) -> PPO:
    """An algorithm for both players, which never does what its mask forbids."""
    shape, actions = env.observation_space.shape, int(env.action_space.n)

    def net() -> Net:
        return Net(state_shape=shape, hidden_sizes=[64, 64], activation=torch.nn.Tanh)

    actor = DiscreteActor(preprocess_net=net(), action_shape=actions, softmax_output=False)
    policy = DiscreteActorPolicy(
        actor=adapter.masked(actor), action_space=env.action_space, deterministic_eval=True
    )
    return PPO(
        policy=policy,
        critic=adapter.unmasked(DiscreteCritic(preprocess_net=net())),
        optim=AdamOptimizerFactory(lr=1e-3),
        gamma=0.99,
        gae_lambda=0.95,
        ent_coef=0.1,
        vf_coef=0.5,
        max_grad_norm=0.5,
        eps_clip=0.2,
        max_batchsize=8_192,
    )


def learner_of(file: Path | None, seed: int, boards: int) -> tuple[Any, Any]:
    """An algorithm, as it was saved where there is a file, and boards for it to learn from."""
    env = adapter.vector_env(TASK, boards, engine="kernel", seed=seed, check=None)
    learner = player(env)
    if file is not None:
        learner.load_state_dict(torch.load(file))
    return learner, env


def learn(learner: Any, env: Any, steps: int, each: int, file: Path) -> Path:
    """Goes on for so many decisions and saves the algorithm, optimizer and all."""
    collector = adapter.Collector(learner, env, VectorReplayBuffer(4 * each, len(env)))
    learner.run_training(
        OnPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=steps,
            collection_step_num_env_steps=each,
            batch_size=256,
            update_step_num_repetitions=6,
            show_progress=False,
            verbose=False,
        )
    )
    env.close()
    torch.save(learner.state_dict(), file)
    return file


def points(learnt: Any, games: int, folder: Path) -> list[float]:
    """Points in so many games as either player, against random ones; they are recorded."""
    found = []
    for me, other in (("player_1", "player_2"), ("player_2", "player_1")):
        policies = {me: learnt, other: "random"}
        evidence = gk.rollout(TASK, policies=policies, episodes=games, seed=UNSEEN, out=folder / me)
        paid = [0.0] * games
        for row in evidence.agent_steps.to_pylist():
            paid[row["episode"]] += (row["reward"] or 0.0) if row["agent"] == me else 0.0
        found += [0.5 + one / 2 for one in paid]  # 1 for a win, -1 for a loss
    return found


def main() -> int:
    """Learns in two halves, is judged out of the last file, and prints one JSON line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=300_000, help="decisions of both players")
    parser.add_argument("--quick", action="store_true", help="a few steps, to see that it runs")
    options = parser.parse_args()
    boards, each, steps, judged = 64, 2_048, options.steps, 200
    if options.quick:
        boards, each, steps, judged = 4, 64, 256, 50
    torch.set_num_threads(1)
    torch.manual_seed(options.seed)
    np.random.seed(options.seed)  # Tianshou draws its batches from it
    logging.getLogger("tianshou").setLevel(logging.ERROR)

    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder, file = Path(name), None
        for seed in (options.seed, options.seed + 1_000):
            learner, env = learner_of(file, seed, boards)
            file = learn(learner, env, steps // 2, each, folder / f"{seed}.pt")
        learner, env = learner_of(file, 0, 1)
        found = points(adapter.policy(learner, env), judged, folder)
        env.close()
        is_replayed = all(gk.replay(folder / me).verified for me in ("player_1", "player_2"))
    seconds = time.perf_counter() - begun

    result = float(np.mean(found))
    shown = one_sample(found, rng=np.random.default_rng(0))
    reached = result >= WANTED
    print(
        json.dumps(
            {
                "example": "tianshou_tictactoe",
                "trainer": f"tianshou {adapter.VERSION}",
                "task": TASK,
                "seed": options.seed,
                "steps": steps,
                "seconds": round(seconds, 1),
                "measure": f"points a game, {2 * judged} games",
                "result": round(result, 3),
                "interval": [round(shown.low, 3), round(shown.high, 3)],
                "replayed": is_replayed,
                "wanted": WANTED,
                "reached": reached,
            }
        )
    )
    return 0 if is_replayed and (reached or options.quick) else 1


if __name__ == "__main__":
    sys.exit(main())
