"""What Stable-Baselines3's own buffers hold after it has played the ledger, against the log."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.errors import SpecError
from gamekeeper.randomness.seeds import episode_seed
from tests.adapters import ledger
from tests.adapters.ledger import Cell, Code, Decision

ENVS, EPISODES, SEED, GAMMA = 2, 2, 3, 0.5
REFUSED: Final = "refused: values in parts stand where it takes none"
EXPECTED: Final = {"Tuple": REFUSED, "nested Dict": REFUSED}


def value(code: Code) -> float:
    """Value of a place, another one for each, exact in float32."""
    return 64 * code[0] + 16 * code[1] + code[2] + code[3] / 8


def log(cell: Cell) -> dict[Code, Decision]:
    """All decisions of the learners in the first episodes, by what was seen."""
    found = {}
    for episode in range(ENVS * EPISODES):
        for decision in ledger.decisions(cell, episode_seed(SEED, episode)):
            if decision.agent < len(cell.learners):
                assert decision.seen not in found, "two seeds look the same: choose another run"
                found[decision.seen] = decision
    return found


def steps_of(cell: Cell) -> int:
    """Steps after which all these episodes are over."""
    ticks = max(ledger.ENDS[cell.ends])
    return EPISODES * ticks * (1 if cell.api == "parallel" else ledger.TURNS_A_TICK)


def on_policy(cell: Cell) -> str:
    """Fills a rollout buffer by Stable-Baselines3's own loop and compares it; says why if refused.

    The network is replaced by the ledger's rule and by `value`, so that an advantage (lambda 0)
    is exactly the reward that was credited, half the value of what followed, less that of what was
    seen: one number for credit, end and final observation.
    """
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import PPO

    from gamekeeper.adapters import sb3

    venv = _opened(cell)
    if isinstance(venv, str):
        return venv
    steps = steps_of(cell)
    model = (MaskablePPO if cell.mask else PPO)(
        network(venv.observation_space),
        venv,
        n_steps=steps,
        batch_size=2,
        gamma=GAMMA,
        gae_lambda=0.0,
        device="cpu",
        policy_kwargs={"net_arch": []},
        **sb3.buffer(venv, masked=cell.mask),
    )
    asked = by_rule(model.policy, cell)
    _, callback = model._setup_learn(1)
    model.collect_rollouts(model.env, callback, model.rollout_buffer, n_rollout_steps=steps)
    compare(model.rollout_buffer, cell, asked)
    venv.close()
    return ""


def off_policy(cell: Cell) -> str:
    """Fills a replay buffer as `on_policy` does a rollout buffer; says why if refused."""
    from stable_baselines3 import DQN, SAC
    from stable_baselines3.common.type_aliases import TrainFreq, TrainFrequencyUnit

    from gamekeeper.adapters import sb3

    if cell.form not in ("Box", "Discrete"):
        return "no algorithm: DQN takes Discrete actions, SAC Box"
    venv = _opened(cell)
    if isinstance(venv, str):
        return venv
    model: Any = (SAC if cell.form == "Box" else DQN)(
        network(venv.observation_space),
        venv,
        buffer_size=200,
        device="cpu",
        policy_kwargs={"net_arch": []},
        **sb3.replay_buffer(venv),
    )

    def sampled(*_: Any) -> Any:
        codes = [ledger.decode(cell.seen, row) for row in rows(model._last_obs)]
        acts = np.array([ledger.act(cell.form, code, masked=cell.mask) for code in codes])
        return acts, acts

    model._sample_action = sampled
    _, callback = model._setup_learn(1)
    freq = TrainFreq(steps_of(cell), TrainFrequencyUnit.STEP)
    model.collect_rollouts(model.env, callback, freq, model.replay_buffer, learning_starts=0)
    compare_transitions(model.replay_buffer, cell)
    venv.close()
    return ""


def _opened(cell: Cell) -> Any:
    """The adapter's environment of a cell, or why it is refused."""
    from gamekeeper.adapters import sb3

    role = {"role": "dog", "others": "first-legal"} if cell.roles == 2 else {}
    try:
        return sb3.vec_env(cell.spec, ENVS, check=None, seed=SEED, env_kwargs=cell.kwargs, **role)
    except SpecError as error:
        return f"refused: {str(error).splitlines()[0].rpartition(': ')[2]}"


def network(space: Any) -> str:
    """The name of the policy that reads such observations."""
    if isinstance(space, spaces.Dict):
        return "MultiInputPolicy"
    return "CnnPolicy" if len(space.shape) == 3 else "MlpPolicy"


def rows(seen: Any) -> list[Any]:
    """Observations one by one, of a batch of tensors or arrays."""
    if isinstance(seen, dict):
        parts = {key: rows(part) for key, part in seen.items()}
        return [dict(zip(parts, row, strict=True)) for row in zip(*parts.values(), strict=True)]
    return list(np.asarray(seen))


def by_rule(policy: Any, cell: Cell) -> list[Code]:
    """Puts the rule in place of a policy's network; returns the codes of single values asked for.

    Stable-Baselines3 asks for the value of one observation alone where it was cut off.
    """
    import torch

    alone: list[Code] = []

    def values(seen: Any) -> Any:
        codes = [ledger.decode(cell.seen, row) for row in rows(seen)]
        if len(codes) == 1:
            alone.extend(codes)
        return torch.tensor([[value(code)] for code in codes])

    def forward(seen: Any, deterministic: bool = False, action_masks: Any = None) -> Any:
        codes = [ledger.decode(cell.seen, row) for row in rows(seen)]
        acts = np.array([ledger.act(cell.form, code, masked=cell.mask) for code in codes])
        known = torch.tensor([[value(code)] for code in codes])
        return torch.as_tensor(acts), known, torch.zeros(len(codes))

    policy.forward, policy.predict_values = forward, values
    return alone


def compare(buffer: Any, cell: Cell, alone: list[Code]) -> None:
    """Asserts that a rollout buffer holds the log, transition by transition."""
    expected = log(cell)
    seen = [_unbatched(row, cell) for row in rows(_squeezed(buffer.observations))]
    codes = [ledger.decode(cell.seen, row) for row in seen]
    assert sorted(codes) == sorted(expected)
    for at, code in enumerate(codes):
        decision, follows = expected[code], expected[code].following
        assert follows is not None
        ledger.same(seen[at], ledger.encode(cell.seen, code))
        np.testing.assert_array_equal(buffer.actions[at, 0].ravel(), np.ravel(decision.action))
        if cell.mask:
            flags = ledger.flat_flags(cell.form, code)
            ledger.same(buffer.action_masks[at, 0].ravel(), flags)
        goes_on = 0.0 if decision.end[0] else GAMMA
        credited = decision.reward + goes_on * value(follows) - value(code)
        assert buffer.advantages[at, 0] == credited
        assert buffer.returns[at, 0] == credited + value(code)
    cut = [d.following for d in expected.values() if d.end == (False, True)]
    assert sorted(alone) == sorted(cut)


def compare_transitions(buffer: Any, cell: Cell) -> None:
    """Asserts that a replay buffer holds the log, transition by transition."""
    expected, count = log(cell), buffer.pos
    both = [
        [_unbatched(row, cell) for row in rows(_squeezed(part))][:count]
        for part in (buffer.observations, buffer.next_observations)
    ]
    codes = [ledger.decode(cell.seen, row) for row in both[0]]
    assert sorted(codes) == sorted(expected)
    for at, code in enumerate(codes):
        decision = expected[code]
        assert decision.following is not None
        ledger.same(both[0][at], ledger.encode(cell.seen, code))
        ledger.same(both[1][at], ledger.encode(cell.seen, decision.following))
        ledger.same(buffer.actions[at, 0].ravel(), np.ravel(decision.action))
        assert buffer.rewards[at, 0] == decision.reward
        assert bool(buffer.dones[at, 0]) == any(decision.end)
        assert bool(buffer.timeouts[at, 0]) == (decision.end == (False, True))


def _squeezed(seen: Any) -> Any:
    """Without the axis of environments, of which a finished buffer has one."""
    if isinstance(seen, dict):
        return {key: part[:, 0] for key, part in seen.items()}
    return seen[:, 0]


def _unbatched(row: Any, cell: Cell) -> Any:
    """An observation in its space's form: pictures with their channels last, numbers bare."""
    if isinstance(row, dict):
        return {key: part if key == "place" else part.ravel()[0] for key, part in row.items()}
    if cell.seen == "image":
        return np.moveaxis(row, 0, -1)
    return row.ravel()[0] if cell.seen == "Discrete" else row
