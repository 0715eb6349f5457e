"""Openers of whole families: JaxMARL, Jumanji, PyMARL, marlenv, OpenSpiel."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiBinary

from gamekeeper.errors import DependencyError, SpecError
from gamekeeper.foreign._spaces import as_gymnasium, box, idle
from gamekeeper.foreign.jaxmarl import JaxMarl, key_of
from gamekeeper.foreign.jumanji import Jumanji
from gamekeeper.foreign.marlenv import MarlEnv
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.opening import distrust, open_env, reopen
from gamekeeper.runs.comparison import replay_evidence
from gamekeeper.runs.recording import rollout
from tests.interface.other_shapes import Particles, plain_jax

MARINES = "pymarl:tests.interface.other_shapes:Marines"


def to_the_end(env: Any, action: Any = 0) -> list[Any]:
    """Every tick of an episode in which everybody does the same."""
    env.reset(seed=1)
    ticks = []
    while env.agents:
        ticks.append(env.step(dict.fromkeys(env.agents, action)))
    return ticks


# -- JaxMARL


def test_jaxmarl_agents_end_each_by_their_own_done() -> None:
    """`b` terminates at its done, `a` in the tick of max_steps is truncated; nothing resets."""
    env = JaxMarl(Particles(), plain_jax(), name="particles")
    ticks = to_the_end(env, 1)
    assert [len(tick[0]) for tick in ticks] == [2, 2, 2, 1, 1]
    assert ticks[2][2] == {"a": False, "b": True}
    assert (ticks[-1][2], ticks[-1][3]) == ({"a": False}, {"a": True})
    assert env.endings == {"a": "time limit"}


def test_jaxmarl_gives_own_writable_arrays_masks_and_infos() -> None:
    """An info by agent comes apart, masks stand in infos, arrays are NumPy's and may be written."""
    env = JaxMarl(Particles(), plain_jax(), name="particles")
    seen, infos = env.reset(seed=1)
    seen["a"][0] = -1
    assert infos["a"]["action_mask"].tolist() == [1, 1, 1]
    *_, infos = env.step({"a": 0, "b": np.int64(2)})
    assert (infos["a"]["who"], infos["b"]["who"]) == (1, 2)
    assert Box(-np.inf, np.inf, (2,), np.float32) == env.observation_space("a")


def test_jaxmarl_seed_counts_in_all_its_bits() -> None:
    """A seed below 2**32 is JAX's own key, the bits above it count too."""
    jax = plain_jax()
    assert jax.random.PRNGKey(9) == key_of(jax, 9)
    assert len({key_of(jax, 9), key_of(jax, 9 + (1 << 32)), key_of(jax, 9 + (1 << 62))}) == 3


# -- Jumanji


class Spec(SimpleNamespace):
    """An array's specification."""


def depot(*, shared: bool) -> Any:
    """Jumanji's shape, two agents: a discount each, or one reward and one discount for both."""
    observation = SimpleNamespace(
        agents_view=Spec(shape=(2, 3), dtype=np.dtype("int32")),
        action_mask=Spec(shape=(2, 4), dtype=np.dtype(bool), minimum=False, maximum=True),
        grid=Spec(shape=(2, 2), dtype=np.dtype("int8"), minimum=0, maximum=9),
        step_count=Spec(shape=(), dtype=np.dtype("int32"), minimum=0, maximum=99),
    )

    def told(ticks: int) -> Any:
        over = ticks >= 4
        each = np.array([1.0, float(ticks < 2)], np.float32)
        return SimpleNamespace(
            step_type=2 if over else 1,
            reward=np.float32(0.5) if shared else np.array([0.5, ticks], np.float32),
            discount=np.float32(not over) if shared else each,
            observation=SimpleNamespace(
                agents_view=np.full((2, 3), ticks, np.int32),
                action_mask=np.ones((2, 4), bool),
                grid=np.zeros((2, 2), np.int8),
                step_count=np.int32(ticks),
            ),
            extras={"delivered": np.int32(ticks)},
        )

    return SimpleNamespace(
        num_agents=2,
        action_spec=Spec(shape=(2,), dtype=np.dtype("int32"), num_values=np.array([4, 4])),
        observation_spec=observation,
        reward_spec=Spec(shape=() if shared else (2,)),
        reset=lambda key: (0, told(0)),
        step=lambda state, action: (state + 1, told(state + 1)),
    )


def test_jumanji_rows_go_to_agents_and_the_board_to_all() -> None:
    """Fields with an axis of agents come apart, `grid` stays whole, masks are int8."""
    env = Jumanji(depot(shared=False), plain_jax(), name="depot")
    seen, infos = env.reset(seed=0)
    space = env.observation_space("agent_1")
    assert space.contains(seen["agent_1"]), seen["agent_1"]
    assert {name: part.shape for name, part in space.items()} == {
        "agents_view": (3,),
        "action_mask": (4,),
        "grid": (2, 2),
        "step_count": (),
    }
    assert infos["agent_0"]["delivered"] == 0
    assert env.contract.mask_of("agent_0") == "observation.action_mask"


def test_jumanji_discount_tells_terminations_from_truncations() -> None:
    """Discount 0 terminates its agent, a last step with a discount truncates who is left."""
    ticks = to_the_end(Jumanji(depot(shared=False), plain_jax(), name="depot"))
    assert ticks[1][2] == {"agent_0": False, "agent_1": True}
    assert (ticks[-1][2], ticks[-1][3]) == ({"agent_0": False}, {"agent_0": True})
    assert ticks[1][1] == {"agent_0": 0.5, "agent_1": 2.0}


def test_jumanji_shared_reward_is_paid_in_full_and_declared() -> None:
    """One reward is everybody's, under a term that the contract calls shared."""
    env = Jumanji(depot(shared=True), plain_jax(), name="depot")
    ticks = to_the_end(env)
    assert ticks[0][1] == {"agent_0": 0.5, "agent_1": 0.5}
    assert ticks[-1][2] == {"agent_0": True, "agent_1": True}
    assert env.contract.rewards["team"].kind == "shared"
    assert env.terms["agent_1"] == {"team": 0.5}


# -- PyMARL


def test_pymarl_limit_truncates_and_a_win_terminates() -> None:
    """`episode_limit` in the info is a truncation, any other end a termination."""
    limited = to_the_legal_end(open_env(MARINES).env)
    assert ({False}, {True}) == tuple(set(flags.values()) for flags in limited[2:4])
    won = to_the_legal_end(open_env(MARINES, wins_at=2).env)
    assert ({True}, {False}) == tuple(set(flags.values()) for flags in won[2:4])
    assert {10.0} == set(won[1].values())


def to_the_legal_end(env: Any) -> Any:
    """The last tick of first legal actions."""
    _, infos = env.reset(seed=1)
    while env.agents:
        legal = {agent: int(np.argmax(infos[agent]["action_mask"])) for agent in env.agents}
        out = env.step(legal)
        infos = out[4]
    return out


def test_pymarl_rollout_replays_with_masks_state_and_the_team_term() -> None:
    """Masked random play replays, its reward stands under `team`, and `state()` is kept."""
    evidence = rollout(MARINES, episodes=2, seed=3)
    assert replay_evidence(evidence, reopen(evidence.manifest["environment"])).verified
    assert not any(evidence.agent_steps["nonconforming"].to_pylist())
    assert {0.5, None} == set(evidence.agent_steps["reward.team"].to_pylist())
    env = open_env(MARINES).env
    env.reset(seed=(3 << 32) + 4)
    assert env.guest.seeded == 4
    assert env.state_space.contains(env.state())


def test_pymarl_shape_is_asked_for_its_methods() -> None:
    """What lacks them is refused with their names."""
    with pytest.raises(SpecError, match="without get_env_info, get_obs"):
        open_env("pymarl:tests.interface.other_shapes:Lists")


# -- marlenv


def kitchen(*, rewards: int = 1) -> Any:
    """The shape of `marlenv`: steps are objects, the reward a vector."""

    class Kitchen:
        n_agents, n_actions, horizon = 2, 3, 3
        observation_shape, extras_shape = (4,), (1,)
        state_shape, state_extras_shape = (2,), (1,)
        action_space = SimpleNamespace(is_discrete=True)
        reward_space = SimpleNamespace(size=rewards, labels=["soup", "time"][:rewards])

        def available_actions(self) -> Any:
            return np.array([[True, False, True]] * 2)

        def seen(self) -> Any:
            return SimpleNamespace(
                data=np.zeros((2, 4), np.float32),
                extras=np.ones((2, 1), np.float32),
                available_actions=self.available_actions(),
            )

        def get_state(self) -> Any:
            return SimpleNamespace(data=np.zeros(2, np.float32), extras=np.ones(1, np.float32))

        def reset(self, *, seed: int | None = None) -> Any:
            self.ticks = 0
            return self.seen(), self.get_state()

        def step(self, action: Any) -> Any:
            self.ticks += 1
            paid = np.array([1.0, -0.25][:rewards], np.float32)
            return SimpleNamespace(
                obs=self.seen(), reward=paid, done=self.ticks == 3, truncated=False, info={}
            )

    return Kitchen()


def test_marlenv_splits_rows_and_truncates_at_the_horizon() -> None:
    """Data and extras are a Dict for each, masks stand in infos, the horizon truncates."""
    env = MarlEnv(kitchen(), name="kitchen")
    seen, infos = env.reset(seed=0)
    assert env.observation_space("agent_0").contains(seen["agent_0"])
    assert infos["agent_1"]["action_mask"].tolist() == [1, 0, 1]
    ticks = to_the_end(env)
    assert len(ticks) == 3
    assert ticks[-1][3] == {"agent_0": True, "agent_1": True}
    assert env.state_space.contains(env.state())


def test_marlenv_objectives_are_terms_whose_sum_is_paid() -> None:
    """A vector of rewards is summed, and stands whole in the terms."""
    env = MarlEnv(kitchen(rewards=2), name="kitchen")
    (_, rewards, *_), *_ = to_the_end(env)
    assert rewards == {"agent_0": 0.75, "agent_1": 0.75}
    assert env.terms["agent_0"] == {"objective_soup": 1.0, "objective_time": -0.25}
    assert rewards["agent_0"] == sum(env.terms["agent_0"].values())


# -- OpenSpiel, and all families


@pytest.mark.parametrize(
    ("game", "given"),
    [("tic_tac_toe", {}), ("kuhn_poker", {"players": 3}), ("matrix_rps", {}), ("goofspiel", {})],
)
def test_openspiel_games_replay(game: str, given: dict[str, Any]) -> None:
    """Turns, chance and simultaneous moves are recorded and replayed bit for bit."""
    pytest.importorskip("pyspiel", reason="open-spiel is no requirement")
    pytest.importorskip("shimmy", reason="shimmy is no requirement")
    evidence = rollout(f"openspiel:{game}", episodes=2, seed=5, env_kwargs=given)
    assert replay_evidence(evidence, reopen(evidence.manifest["environment"])).verified
    assert {"ended"} == set(evidence.episode_table["end"].to_pylist())


def test_openspiel_refuses_unknown_and_mean_field_games() -> None:
    """A near name is offered; a game of a population has no agents to play it."""
    pytest.importorskip("pyspiel", reason="open-spiel is no requirement")
    pytest.importorskip("shimmy", reason="shimmy is no requirement")
    with pytest.raises(SpecError, match="'tic_tac_toe'"):
        open_env("openspiel:tic_tac_to")
    with pytest.raises(SpecError, match="mean-field"):
        open_env("openspiel:mfg_crowd_modelling")


@pytest.mark.parametrize("word", ["jaxmarl", "jumanji", "overcooked", "pogema", "momaland"])
def test_family_names_what_to_install(word: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its package a family says which line installs it, and evidence isn't trusted."""
    there = foreign_openers.importlib.util.find_spec

    def absent(name: str, package: str | None = None) -> Any:
        return None if name == word else there(name, package)

    monkeypatch.setattr("importlib.util.find_spec", absent)
    with pytest.raises(DependencyError, match=f"pip install {word}"):
        open_env(f"{word}:anything")
    identity = {"kind": word, "entry_point": f"{word}:anything", "api": "parallel"}
    assert distrust(identity) is not None


def test_family_words_are_found_by_walking() -> None:
    """Every opener with a word is known to the one that reads words as modules."""
    assert {
        "gymnasium",
        "gym",
        "jaxmarl",
        "jumanji",
        "momaland",
        "openspiel",
    } <= foreign_openers.words()


def test_spaces_are_read_by_the_names_of_their_classes() -> None:
    """Spaces of libraries that aren't installed keep bounds, dtypes and numbers."""
    low = np.array([-1.0, -np.inf])
    foreign = type("Box", (), {})()
    foreign.low, foreign.high, foreign.shape, foreign.dtype = low, 2.0, (2,), "float32"
    assert Box(np.float32([-1, -np.inf]), np.float32([2, 2]), dtype=np.float32) == as_gymnasium(
        foreign
    )
    with pytest.raises(SpecError, match="no likeness"):
        as_gymnasium(object())


@pytest.mark.parametrize(
    "dtype", ["int8", "uint8", "int32", "uint32", "int64", "uint64", "float16"]
)
def test_box_without_bounds_holds_the_ends_of_its_dtype(dtype: str) -> None:
    """Whole numbers without bounds get their dtype's own, to the last bit."""
    made = box(-np.inf, np.inf, (2,), dtype)
    kind = np.dtype(dtype)
    limits = np.finfo(kind) if kind.kind == "f" else np.iinfo(kind)
    ends = (-np.inf, np.inf) if kind.kind == "f" else (limits.min, limits.max)
    assert ends == (made.low[0], made.high[0])
    assert kind == made.dtype


@pytest.mark.parametrize(
    "space", [Discrete(3, start=2), Box(1.0, 2.0, (2,)), MultiBinary(3), as_gymnasium(Discrete(4))]
)
def test_idle_action_lies_in_its_space(space: Any) -> None:
    """What stands in a list for an agent that has ended is an action that its space knows."""
    assert space.contains(idle(space))


def test_family_names_whose_environment_it_is() -> None:
    """An identity has the guest's own versions, and an installed family needs no leave to run."""
    pytest.importorskip("pyspiel", reason="open_spiel isn't installed")
    identity = open_env("openspiel:tic_tac_toe").identity
    assert "shimmy" in identity["versions"]
    assert distrust(identity) is None
