import copy
import functools
from types import SimpleNamespace

import numpy as np
import pettingzoo
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pettingzoo.test import api_test, render_test, seed_test
from pettingzoo.test.state_test import test_state as check_state
from pettingzoo.test.state_test import test_state_space as check_state_space

import gamekeeper.tasks  # noqa: F401  # registers the tasks
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import ActionError, SpecError
from gamekeeper.interface.contract_draft import agent_specs, draft_contract
from gamekeeper.tasks.handover.handover import GIVER, RECEIVER, Handover
from gamekeeper.tasks.handover.handover_rules import GRASP, REACH, RELEASE, RETRACT, WAIT
from gamekeeper.tasks.knobs import LABELS
from tests.tasks.disturbed import rows

HARD = dict.fromkeys(LABELS, 0.3) | {"observation_delay": 1, "latency": 1, "slowness": 1}


def begun(seed=0, **arguments):
    """A task at the start of an episode, with a part on its tray."""
    env = Handover(**arguments)
    env.reset(seed=seed)
    while not env.tray:
        env.step(WAIT)
    return env


def do(env, **turns):
    """Plays arms' next actions (`giver=[...]`), each in its turn; who has none left waits."""
    left = {GIVER: turns.get("giver", []), RECEIVER: turns.get("receiver", [])}
    left = {agent: list(actions) for agent, actions in left.items()}
    while any(left.values()) and not env.endings:
        actions = left[env.agent_selection]
        env.step(actions.pop(0) if actions else WAIT)
    return env


IN_SLOT = [GRASP, REACH, REACH, REACH, RELEASE]
OUT = [RETRACT] * 3


def test_handover_conforms_to_pettingzoo():
    """PettingZoo's own tests pass on the registered task, and nothing warns."""
    make = functools.partial(pettingzoo.make, "aec", "gamekeeper/handover-v0")
    api_test(make(), num_cycles=100)
    seed_test(make, num_cycles=50)
    check_state_space(make())
    check_state(make(), 50)
    render_test(lambda **mode: Handover(**mode), {})


def test_handover_ends_after_its_cycles():
    """PettingZoo's own test of time limits finds each arm with its turn in each tick."""
    env = Handover(horizon=4, gap=100)
    env.reset(seed=0)
    counts = {GIVER: 0, RECEIVER: 0}
    for agent in env.agent_iter():
        counts[agent] += 1
        env.step(None if env.truncations[agent] else WAIT)
    assert counts == {GIVER: 5, RECEIVER: 5}
    assert env.endings == {GIVER: "horizon", RECEIVER: "horizon"}


@pytest.mark.parametrize(("reach", "shared", "slot"), [(2, 3, 3), (1, 1, 1), (3, 2, 4), (2, 4, 4)])
def test_handover_has_its_slot_in_the_middle(reach, shared, slot):
    """R1: cells of each arm's own, those both can reach between them, the slot in the middle."""
    env = Handover(reach=reach, shared=shared)
    seen, *_ = (env.reset(seed=1), env.last())[1]
    assert env.cells == 2 * reach + shared
    assert slot == env.slot_cell == seen[6]
    assert env.arms[GIVER].extension == env.arms[RECEIVER].extension == 0


def test_handover_parts_arrive_whatever_is_done():
    """R2: arrivals depend on the seed alone, the first within `gap`, then gaps of `gap` on mean."""
    env, gaps = Handover(parts=6, debug=True), []
    for seed in range(100):
        env.reset(seed=seed)
        times = env.arrivals
        assert 1 <= times[0] <= 16
        gaps += np.diff(times).tolist()
        other = Handover(parts=6, reach=5, shared=1, debug=True)
        other.reset(seed=seed)
        assert other.arrivals == times
    assert (min(gaps), max(gaps)) == (1, 31)
    assert 15 < np.mean(gaps) < 17


def test_handover_pays_everybody_for_a_part_in_the_bin():
    """R3, R7: the giver is paid for the handover, all for the delivery."""
    env = do(begun(), giver=IN_SLOT)
    assert env.rewards == {GIVER: 0.2, RECEIVER: 0.0}
    do(env, giver=OUT)
    do(env, receiver=[REACH, REACH, REACH, GRASP, *OUT, RELEASE])
    assert env.rewards == {GIVER: 1.0, RECEIVER: 1.0}
    assert env.terms == {GIVER: {"delivery": 1.0}, RECEIVER: {"delivery": 1.0}}
    assert env.delivered == 1


def test_handover_gives_the_turn_to_who_is_ready_first():
    """R4: a move with a part takes two units, so the other acts twice meanwhile."""
    env = do(begun(gap=60), giver=[GRASP])
    order = []
    for _ in range(8):
        agent = env.agent_selection
        order.append(agent[0])
        env.step(REACH if agent == GIVER and env.mask(GIVER)[REACH] else WAIT)
    assert "".join(order) == "rgrrgrrg"


@pytest.mark.parametrize(("reaches", "then"), [(2, RECEIVER), (1, GIVER)])
def test_handover_gives_a_tie_to_who_is_in_the_shared_space(reaches, then):
    """R4: of two that are ready, who is in the shared space acts first; else the giver."""
    env = do(begun(gap=60), receiver=[REACH] * reaches)
    assert env.is_inside(RECEIVER) == (then == RECEIVER)
    while env.arms[GIVER].ready != env.arms[RECEIVER].ready:
        env.step(WAIT)
    assert env.agent_selection == then


def test_handover_moves_cost_effort():
    """R5: reach and retract by a cell, each move paid for; to wait costs nothing."""
    env = do(begun(gap=60), giver=[REACH])
    assert env.arms[GIVER].extension == 1
    assert env.terms == {GIVER: {"effort": -0.01}}
    do(env, giver=[RETRACT])
    assert env.arms[GIVER].extension == 0
    do(env, giver=[WAIT])
    assert env.rewards[GIVER] == 0.0


def test_handover_hands_grasp_what_lies_under_them():
    """R6: parts leave the tray in the order they came; what lies in the slot either arm takes."""
    env = do(begun(), giver=IN_SLOT)
    assert (env.slot, env.arms[GIVER].part) == (1, None)
    do(env, giver=[GRASP])
    assert (env.slot, env.arms[GIVER].part) == (None, 1)


def test_handover_is_paid_once_for_each_part():
    """R7: to take a part back and put it down again earns nothing."""
    env = do(begun(gap=60), giver=[*IN_SLOT, GRASP, RELEASE])
    assert env.slot == 1
    assert env.rewards[GIVER] == 0.0


@pytest.mark.parametrize("moves", [1, 2, 4])
def test_handover_drops_a_part_that_is_released_elsewhere(moves):
    """R7, R11: anywhere but in tray, slot and bin a part is dropped, and everybody loses."""
    env = do(begun(gap=60), giver=[GRASP, *[REACH] * moves, RELEASE])
    assert env.endings == {GIVER: "dropped", RECEIVER: "dropped"}
    assert env.rewards == {GIVER: -1.0, RECEIVER: -1.0}


def test_handover_may_put_a_part_back():
    """R7: the tray takes a part back where there is room."""
    env = do(begun(gap=60), giver=[GRASP, RELEASE])
    assert env.tray == [1]
    assert not env.endings


def test_handover_masks_what_is_forbidden():
    """R8: the ends of the arm, full and empty hands, and the space while the other is in it."""
    env = begun(gap=60)
    assert env.mask(GIVER).tolist() == [0, 1, 1, 0, 1]
    assert env.mask(RECEIVER).tolist() == [0, 1, 0, 0, 1]
    do(env, giver=[GRASP])
    assert env.mask(GIVER).tolist() == [0, 1, 0, 1, 1]
    do(env, giver=[REACH], receiver=[REACH, REACH])
    assert env.is_inside(RECEIVER)
    assert env.mask(GIVER).tolist() == [1, 0, 0, 1, 1]
    do(env, receiver=[REACH, REACH])
    assert env.mask(RECEIVER).tolist() == [1, 0, 0, 0, 1]


@pytest.mark.parametrize("action", [RETRACT, RELEASE])
def test_handover_fault_costs_and_does_nothing(action):
    """R9: what is masked out costs the penalty; what can't be done does nothing."""
    env = begun(gap=60)
    before = env.state().tolist()
    do(env, giver=[action])
    assert env.rewards == {GIVER: -0.1, RECEIVER: 0.0}
    assert env.terms == {GIVER: {"fault": -0.1}}
    assert env.state().tolist()[:2] == before[:2]


def test_handover_reaching_in_on_the_other_is_a_collision():
    """R9, R11: who reaches in while the other is there pays for the fault, and everybody loses."""
    env = do(begun(gap=60), giver=[REACH], receiver=[REACH, REACH])
    do(env, giver=[REACH])
    assert env.endings == {GIVER: "collision", RECEIVER: "collision"}
    assert env.rewards == {GIVER: -1.1, RECEIVER: -1.0}
    assert env.terms == {GIVER: {"fault": -0.1, "loss": -1.0}, RECEIVER: {"loss": -1.0}}


@pytest.mark.parametrize("action", [5, -1, None, "reach", 1.0])
def test_handover_refuses_what_is_no_action(action):
    """R9 is about actions that there are: anything else is an error and changes nothing."""
    env = begun()
    before = env.state().tolist()
    with pytest.raises(ActionError):
        env.step(action)
    assert env.state().tolist() == before


def test_handover_is_done_when_all_is_delivered():
    """R10: after the last part all are terminated."""
    env = Handover()
    played = rows(env, 3)
    assert env.endings == {GIVER: "done", RECEIVER: "done"}
    assert played[-1][3] is True
    assert env.state()[8] == 0


def test_handover_overflows_when_nobody_takes_parts():
    """R11: the third part falls off a tray for two."""
    env = Handover()
    rows(env, 3, "lazy")
    assert env.endings == {GIVER: "overflow", RECEIVER: "overflow"}
    assert env.tray == [1, 2]


def test_handover_truncates_at_its_horizon():
    """R12: after the contract's ticks, or those given, all are truncated."""
    env = Handover(horizon=3)
    assert rows(env, 3, "lazy")[-1][3:5] == (False, True)
    assert env.endings == {GIVER: "horizon", RECEIVER: "horizon"}
    assert Handover().declared.schedule.horizon == 240


def test_handover_policies_differ():
    """The reference solves nearly all, the greedy some, the lazy none; all only do what's legal."""
    solved = {}
    for policy in Handover.policies:
        env, ends = Handover(), []
        for seed in range(25):
            faults = [row for row in rows(env, seed, policy, 800) if row[2] in (-0.1, -1.1)]
            ends.append(env.endings[GIVER] == "done")
            assert faults == []
        solved[policy] = sum(ends)
    assert solved["reference"] >= 24
    assert 3 < solved["greedy"] < 22
    assert solved["lazy"] == 0


def test_handover_reference_solves_other_sizes():
    """The reference reads sizes from what it sees."""
    for sizes in ({"reach": 1, "shared": 1}, {"reach": 3, "shared": 4, "gap": 30}, {"parts": 9}):
        env = Handover(**sizes, horizon=900, tray=9, debug=True)
        rows(env, 2, most=3000)
        assert env.endings[GIVER] == "done", sizes


def test_handover_knobs_at_their_ideal_change_nothing():
    """The contract names every knob; at their ideals every row is as without them."""
    declared = Handover().declared.knobs
    assert dict(LABELS) == {name: knob.label for name, knob in declared.items()}
    ideal = Handover(**{name: knob.ideal for name, knob in declared.items()})
    assert rows(Handover(), 5) == rows(ideal, 5)


@pytest.mark.parametrize(
    "name", ["observation_noise", "occlusion", "observation_delay", "odometry_drift"]
)
def test_handover_sensor_knob_changes_what_its_arm_sees_alone(name):
    """Under the same actions the state stays as it was; the arm with the knob sees otherwise."""
    sound, faulty = Handover(), Handover(**{name: {"receiver": HARD[name]}})
    differ = {GIVER: 0, RECEIVER: 0}
    for seed in (1, 2):
        played = rows(sound, seed)
        faulty.reset(seed=seed)
        for agent, seen, *_, action, state in played:
            assert faulty.agent_selection == agent
            assert tuple(faulty.state().tolist()) == state
            differ[agent] += faulty.observe(agent).tolist() != seen
            assert faulty.observe(agent).tolist() == faulty.observe(agent).tolist()
            faulty.step(action)
    assert differ[GIVER] == 0
    assert differ[RECEIVER] > 5


@pytest.mark.parametrize("name", ["actuator_slip", "actuator_dropout", "latency", "slowness"])
def test_handover_motion_knob_changes_its_arm_alone(name):
    """The arm with the knob moves otherwise; what it is shown is true, arrivals are as before."""
    places = {}
    for setting in (0, max(HARD[name], 0.5)):
        env = begun(3, gap=60, **{name: {"receiver": setting}})
        places[setting] = {GIVER: [], RECEIVER: []}
        for turn in range(20):
            agent = env.agent_selection
            assert env.observe(agent)[0] == env.arms[agent].extension
            env.step([REACH, RETRACT][turn // 2 % 2])
            places[setting][agent].append(env.arms[agent].extension)
    sound, faulty = places.values()
    assert sound[GIVER] == faulty[GIVER]
    assert sound[RECEIVER] != faulty[RECEIVER]


def test_handover_held_out_has_its_slot_elsewhere():
    """In held-out layouts the slot is any other shared cell; there must be another one."""
    env, slots = Handover(held_out=1.0), set()
    for seed in range(20):
        env.reset(seed=seed)
        slots.add(env.slot_cell)
    assert slots == {2, 4}
    with pytest.raises(SpecError, match="2 or more"):
        Handover(shared=1, held_out=0.5)


@given(st.integers(0, 2**32), st.lists(st.integers(0, 4), max_size=60), st.booleans())
@settings(max_examples=40)
def test_handover_stays_in_its_spaces(seed, actions, is_hard):
    """Whatever is done: observations, states and masks fit, one arm is in the space, parts stay."""
    env = Handover(**HARD) if is_hard else Handover()
    env.reset(seed=seed)
    for action in actions:
        if env.endings:
            break
        agent = env.agent_selection
        assert env.observation_space(agent).contains(env.observe(agent))
        assert env.state_space.contains(env.state())
        assert not (env.is_inside(GIVER) and env.is_inside(RECEIVER))
        hands = sum(arm.part is not None for arm in env.arms.values())
        lying = len(env.tray) + (env.slot is not None) + env.delivered + len(env.arrivals)
        assert hands + lying == env.parts
        env.step(action)


def test_handover_copies_go_on_alike():
    """A deep copy and a snapshot go on as the original does, knobs and all."""
    env = Handover(**HARD | {"actuator_slip": 0.0})
    env.reset(seed=11)
    for _ in range(9):
        env.step(WAIT)
    counterfactual, shot, ends = copy.deepcopy(env), env.snapshot(), []
    for each in (env, counterfactual):
        ends.append([])
        for action in [REACH, WAIT, REACH, GRASP, RETRACT]:
            each.step(action)
            ends[-1].append((each.state().tolist(), each.last()[0].tolist()))
    env.restore(shot)
    env.step(REACH)
    assert ends[0] == ends[1]
    assert ends[0][0] == (env.state().tolist(), env.last()[0].tolist())


@pytest.mark.parametrize("name", ["reach", "shared", "parts", "tray", "gap"])
@pytest.mark.parametrize("size", [0, -1, 1.5, True])
def test_handover_refuses_impossible_sizes(name, size):
    """A size that can't be names its argument."""
    with pytest.raises(SpecError, match=name):
        Handover(**{name: size})


def test_handover_renders():
    """The text shows tray, hands, slot and bin; the array is a picture of cells."""
    env = begun(render_mode="ansi", gap=60)
    assert env.render() == "1 >.[._.].< 0/4"
    do(env, giver=IN_SLOT)
    assert env.render() == "0 ..[.>.].< 0/4"
    do(env, giver=[RETRACT])
    assert env.render() == "0 ..[>o.].< 0/4"
    env = begun(render_mode="rgb_array")
    assert env.render().shape == (72, 216, 3)
    assert env.render().dtype == np.uint8
    assert begun().render() is None


def test_handover_contract_fits_and_leaves_nothing_open():
    """The contract declares what the draft sees, and answers every question."""
    env = Handover()
    drafted = draft_contract(env)
    assert (env.declared.name, env.declared.api) == (drafted.name, drafted.api)
    assert set(env.declared.roles) == set(drafted.roles)
    specs = agent_specs(env, env.declared)
    assert [spec.noop_action() for spec in specs] == [WAIT, WAIT]
    assert open_questions(env.declared, specs) == ()
    assert SimpleNamespace(**env.metadata).is_parallelizable is False
