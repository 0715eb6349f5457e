"""Stable-Baselines3's PPO through Gamekeeper's adapter, beside the same through SuperSuit.

`spread`: PPO with parameter sharing on mpe2 simple_spread, the same settings, 8 copies, 5 seeds;
arms take turns, each run in a process of its own with one thread. `frames_s` is agent-steps a
second of `learn`, start-up apart, `frames_cpu_s` of its processor time. The final return is that of
the last policy, its likeliest actions, in the same 100 whole episodes for both arms, an agent's
mean; nobody learnt from them. Stated before any run: ours isn't slower (ratio of the medians at
least 1), and its mean over the seeds isn't lower than SuperSuit's by more than MARGIN, a twentieth
of what random play loses.

`value`: a task that only time limits end (`drift`, below), so that what a state is worth without
them is known in closed form: root mean square error of the critic over all states, 5 seeds. Wanted:
ours lower, as `TimeLimit.truncated` is told and what was cut off is bootstrapped.

`overhead`: a step of the VecEnv, less the step of `gk.vector` within it, as a part of that; medians
over steps. Wanted: at most 0.15 for environments in Python. Of kernels, whose steps take as little
as a few calls of NumPy, it is measured and told.

`flight`: PPO on simple_spread with the flight recorder on (`gk.record(venv, ..., level="actions",
keep="failed")`) beside the same without; `learn` and closing together. Then 200 of the episodes
that it retains are replayed each by itself in a fresh environment, every reward, flag and witness
compared. Wanted: at least 0.98 of the frames a second, and all 200 come out.

    python benchmarks/trainers_sb3.py [--parts spread value overhead flight] [--seeds 5] [--quick]

In the environment of `make trainer-test TRAINER=sb3` (.venv-sb3), which has SuperSuit and mpe2.
One JSON line a run, then one a figure: {"figure", "part", ..., "wanted", "reached"}.
"""

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

FIGURE: Final = "trainers_sb3"
SPREAD: Final = "mpe2.simple_spread_v3:parallel_env"
DRIFT: Final = f"{Path(__file__)}:Drift"
ARMS: Final[Mapping[str, tuple[str, str]]] = {
    "spread": ("gamekeeper", "supersuit"),
    "value": ("gamekeeper", "supersuit"),
    "flight": ("recorded", "bare"),
}
COPIES: Final = 8
FRAMES: Final = {"spread": 240_000, "value": 40_000, "flight": 60_000}
"""Agent-steps of a run."""
QUICK: Final = {"spread": 9_600, "value": 9_600, "flight": 9_600}
FAILED: Final = "return < -60"
"""Condition on the return of all three agents together; of random play about two in three fail."""
REPLAYED: Final = 200
FLIGHT: Final = 0.98
EPISODES: Final = 100
UNSEEN: Final = 1_000_000
"""Seed of the run that policies are judged by."""
MARGIN: Final = 1.3
"""Return of an agent; random play loses 26 in an episode."""
SETTINGS: Final[Mapping[str, Mapping[str, Any]]] = {
    "spread": {
        "n_steps": 100,
        "batch_size": 600,
        "n_epochs": 8,
        "gamma": 0.95,
        "learning_rate": 1e-3,
        "ent_coef": 0.003,
    },
    "value": {
        "n_steps": 150,
        "batch_size": 600,
        "n_epochs": 10,
        "gamma": 0.95,
        "learning_rate": 2e-3,
    },
}
OVERHEAD: Final = 0.15
WORK: Final = (
    (SPREAD, 16, "serial"),
    ("warehouse", 64, "serial"),
    ("handover", 64, "serial"),
    ("two_robot_line", 64, "serial"),
    ("spread", 1_024, "kernel"),
    ("warehouse", 1_024, "kernel"),
)
"""Environment, copies, engine."""


# -- a task that only a time limit ends


class Drift(ParallelEnv[str, Any, int]):
    """Two buoys drift round a ring, a cell a tick, and are paid 1 in cell 0; nobody can help it.

    Each sees its cell as one of CELLS flags, begins anywhere, and is cut off after LENGTH ticks.
    """

    CELLS: ClassVar[int] = 8
    LENGTH: ClassVar[int] = 15
    metadata: ClassVar[dict[str, Any]] = {"name": "drift_v0", "render_modes": []}

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.possible_agents = ["buoy_0", "buoy_1"]
        self.agents: list[str] = []
        self.observation_spaces = {
            agent: spaces.Box(0, 1, (self.CELLS,), np.float32) for agent in self.possible_agents
        }
        self.action_spaces = {agent: spaces.Discrete(2) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Any:
        """A flag for each cell."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Two actions that do the same: nothing."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Puts each buoy anywhere."""
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents, self.time = list(self.possible_agents), 0
        self.cells = {agent: int(self.rng.integers(self.CELLS)) for agent in self.agents}
        return self._seen(), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        """Drifts."""
        self.time += 1
        for agent in self.agents:
            self.cells[agent] = (self.cells[agent] + 1) % self.CELLS
        live = self.agents
        paid = {agent: float(self.cells[agent] == 0) for agent in live}
        is_cut = self.time == self.LENGTH
        out = (self._seen(), paid, dict.fromkeys(live, False), dict.fromkeys(live, is_cut))
        told: dict[str, dict[str, Any]] = {agent: {} for agent in live}
        if is_cut:
            self.agents = []
        return *out, told

    def _seen(self) -> Any:
        return {
            agent: np.eye(self.CELLS, dtype=np.float32)[self.cells[agent]] for agent in self.agents
        }


def truth(gamma: float) -> Any:
    """What each cell is worth for ever: [cell], gamma to the ticks before each visit to cell 0."""
    until = (Drift.CELLS - 1 - np.arange(Drift.CELLS)) % Drift.CELLS
    return gamma**until / (1 - gamma**Drift.CELLS)


# -- one run of one arm, in a process of its own


def made(arm: str, part: str, seed: int) -> Any:
    """The environment of an arm as a VecEnv, and what its PPO is made with beside it."""
    if arm != "supersuit":
        from gamekeeper.adapters import sb3

        venv = sb3.vec_env(DRIFT if part == "value" else SPREAD, COPIES, check=None, seed=seed)
        return venv, sb3.buffer(venv)
    import supersuit
    from mpe2 import simple_spread_v3

    env = simple_spread_v3.parallel_env() if part == "spread" else Drift()
    env.reset(seed=seed)
    many = supersuit.pettingzoo_env_to_vec_env_v1(env)
    venv = supersuit.concat_vec_envs_v1(many, COPIES, num_cpus=0, base_class="stable_baselines3")
    venv.seed = lambda seed=None: None  # it has no seeding that PPO could call
    return venv, {}


def run(arm: str, part: str, seed: int, frames: int) -> dict[str, Any]:
    """Learns with one seed, and what came of it."""
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    venv, more = made(arm, part, seed)
    folder = tempfile.mkdtemp(prefix="flight-") if arm == "recorded" else None
    if folder is not None:
        import gamekeeper as gk

        gk.record(venv, f"{folder}/run", level="actions", keep="failed", failed=FAILED)
    settings = SETTINGS["spread" if part == "flight" else part]
    model = PPO("MlpPolicy", venv, device="cpu", seed=seed, **settings, **more)
    began_s, busy_s = time.perf_counter(), time.process_time()
    model.learn(frames)
    if part == "flight":
        venv.close()
    seconds, busy_s = time.perf_counter() - began_s, time.process_time() - busy_s
    done = model.num_timesteps
    found = {
        "frames": done,
        "frames_s": round(done / seconds),
        "frames_cpu_s": round(done / busy_s),
    }
    if part == "value":
        cells = torch.eye(Drift.CELLS)
        with torch.no_grad():
            values = model.policy.predict_values(cells).numpy().ravel()
        error = float(np.sqrt(np.mean((values - truth(model.gamma)) ** 2)))
        return {**found, "error": round(error, 4)}
    if part == "flight":
        return found if folder is None else {**found, **replayed(Path(folder))}
    return {**found, "return": round(judged(model), 3)}


def replayed(folder: Path) -> dict[str, Any]:
    """Failed episodes of a run, how many of the newest come out by themselves, its size."""
    import gamekeeper as gk
    from gamekeeper.runs.expanding import check_task

    evidence = gk.load(folder / "run")
    keep = evidence.manifest["keep"]
    tried = keep["failed"][-REPLAYED:]
    outcomes = [
        check_task(lambda **_: None, path=str(folder / "run"), episode=number)["outcome"]
        for number in tried
    ]
    size = sum(path.stat().st_size for path in (folder / "run").iterdir())
    steps = evidence.agent_steps["action"].drop_null()
    shutil.rmtree(folder)
    return {
        "seen": keep["seen"],
        "retained": keep["retained"],
        "failed": len(keep["failed"]),
        "replayed": len(tried),
        "came_out": outcomes.count("passed"),
        "bytes_an_agent_step": round(size / max(len(steps), 1), 2),
    }


def judged(model: Any) -> float:
    """An agent's mean return in whole episodes that nobody learnt from."""
    import gamekeeper as gk
    from gamekeeper.adapters.sb3 import policy

    plays = "random" if model is None else policy(model)
    evidence = gk.rollout(SPREAD, policies=plays, episodes=EPISODES, seed=UNSEEN)
    paid = evidence.agent_steps.column("reward").to_numpy(zero_copy_only=False)
    return float(np.nansum(paid)) / EPISODES / 3


def overhead(seconds: float) -> None:
    """What the adapter adds to the vector environment's own step."""
    from gamekeeper.adapters import sb3

    rng = np.random.default_rng(0)
    for spec, copies, engine in WORK:
        venv = sb3.vec_env(spec, copies, check=None, engine=engine)
        inner, own, whole = venv.slots.venv, [], []
        step = inner.step

        def timed(actions: Any, step: Any = step, own: list[float] = own) -> Any:
            began_s = time.perf_counter()
            out = step(actions)
            own.append(time.perf_counter() - began_s)
            return out

        inner.step = timed
        venv.reset()
        until_s = time.perf_counter() + seconds
        while time.perf_counter() < until_s or len(whole) < 20:
            masks = venv.slots.masks
            actions = (
                (rng.random(masks.shape) * masks).argmax(1)
                if masks.size
                else rng.integers(0, venv.action_space.n, venv.num_envs)
            )
            began_s = time.perf_counter()
            venv.step(actions)
            whole.append(time.perf_counter() - began_s)
        venv.close()
        added = statistics.median(np.subtract(whole, own))
        ratio, wanted = added / statistics.median(own), None if engine == "kernel" else OVERHEAD
        tell(
            part="overhead",
            env=spec,
            copies=copies,
            engine=engine,
            slots=venv.num_envs,
            own_us=round(1e6 * statistics.median(own), 1),
            added_us=round(1e6 * added, 1),
            ratio=round(ratio, 3),
            wanted=wanted,
            reached=None if wanted is None else bool(ratio <= wanted),
        )


# -- all of them


def compared(part: str, seeds: int, *, quick: bool) -> None:
    """Both arms with every seed, in turns; then the figure."""
    arms = ARMS[part]
    found: dict[str, list[dict[str, Any]]] = {arm: [] for arm in arms}
    for seed in range(seeds):
        for arm in arms if seed % 2 == 0 else arms[::-1]:
            command = [sys.executable, __file__, "--arm", arm, "--parts", part, "--seed", str(seed)]
            if quick:
                command.append("--quick")
            done = subprocess.run(command, capture_output=True, text=True, timeout=1_800)
            if done.returncode:
                raise SystemExit(f"{' '.join(command)}\n{done.stderr[-3_000:]}")
            found[arm].append(json.loads(done.stdout.splitlines()[-1]))
            tell(part=part, arm=arm, seed=seed, **found[arm][-1])
    ours, theirs = (found[arm] for arm in arms)
    if part == "flight":
        tell(
            part=part,
            measure="came_out",
            **{key: sum(each[key] for each in ours) for key in ("replayed", "came_out")},
            wanted=REPLAYED,
            reached=all(each["came_out"] == each["replayed"] == REPLAYED for each in ours),
        )
        speed(part, arms, ours, theirs, wanted=FLIGHT)
        return
    name = "return" if part == "spread" else "error"
    means = [statistics.mean(each[name] for each in arm) for arm in (ours, theirs)]
    deviations = [statistics.pstdev(each[name] for each in arm) for arm in (ours, theirs)]
    about = {
        "seeds": seeds,
        **dict(zip(arms, (round(m, 3) for m in means), strict=True)),
        "deviations": [round(d, 3) for d in deviations],
    }
    if part == "value":
        tell(part=part, measure=name, **about, wanted="lower", reached=bool(means[0] < means[1]))
        return
    speed(part, arms, ours, theirs, wanted=1.0)
    tell(
        part=part,
        measure=name,
        **about,
        random=round(judged(None), 3),
        wanted=f"{-MARGIN} at worst",
        reached=bool(means[0] >= means[1] - MARGIN),
    )


def speed(
    part: str,
    arms: tuple[str, str],
    ours: list[dict[str, Any]],
    theirs: list[dict[str, Any]],
    *,
    wanted: float,
) -> None:
    """Figures of the frames a second of both arms, by the wall and by the processor."""
    for measure in ("frames_s", "frames_cpu_s"):
        speeds = [statistics.median(each[measure] for each in arm) for arm in (ours, theirs)]
        ratio = round(speeds[0] / speeds[1], 3)
        tell(
            part=part,
            measure=measure,
            **dict(zip(arms, speeds, strict=True)),
            ratio=ratio,
            wanted=wanted,
            reached=bool(ratio >= wanted),
        )


def tell(**fields: Any) -> None:
    """One JSON line."""
    print(json.dumps({"figure": FIGURE, **fields}), flush=True)


def main() -> None:
    """Measures what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--parts",
        nargs="+",
        default=["overhead", "value", "spread"],
        choices=["overhead", "value", "spread", "flight"],
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument(
        "--quick", action="store_true", help="short runs that show nothing but that it runs"
    )
    parser.add_argument(
        "--arm", choices=sorted({*sum(ARMS.values(), ())}), help="one run in this process"
    )
    parser.add_argument("--seed", type=int, default=0, help="of that run")
    given = parser.parse_args()
    frames = QUICK if given.quick else FRAMES
    if given.arm:
        warnings.simplefilter("ignore")  # SuperSuit's, of what it is built on
        (part,) = given.parts
        print(json.dumps(run(given.arm, part, given.seed, frames[part])))
        return
    for part in given.parts:
        if part == "overhead":
            overhead(0.5 if given.quick else 4.0)
        else:
            compared(part, given.seeds, quick=given.quick)


if __name__ == "__main__":
    main()
