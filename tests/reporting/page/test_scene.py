"""Scenes show what was recorded: places, things and cells of environments that know them."""

from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.reporting.page.episode_list import packed_of

Scene = dict[str, Any]


def drawing_of(spec: str, **kwargs: Any) -> Scene:
    """The drawing of an episode of random actions."""
    run = gk.rollout(spec, episodes=1, seed=3, env_kwargs=kwargs)
    packed: Scene = packed_of(run, 0)
    drawing: Scene = packed["drawing"]
    return drawing


def first_env(spec: str) -> Any:
    """The environment as that episode began."""
    run = gk.rollout(spec, episodes=1, seed=3)
    env = gk.make(spec)
    env.reset(seed=run.episode(0).seed)
    return env.unwrapped


def test_food_and_players_are_where_the_state_has_them() -> None:
    """Rows count downwards: x is the column."""
    drawing, env = drawing_of("foraging"), first_env("foraging")
    state = np.asarray(env.state())
    count = len(env.possible_agents)
    players = [track[0][1:] for track in drawing["tracks"].values()]
    food = [each["track"][0][1:] for each in drawing["scene"]["things"]]
    assert [[x, y] for y, x, _ in state[:count].tolist()] == players
    assert [[x, y] if level else [None, None] for y, x, level in state[count:].tolist()] == food
    assert drawing["scene"]["size"] == [8, 8]


@pytest.mark.parametrize(
    "spec", ["mpe2.simple_spread_v3:parallel_env", "mpe2.simple_tag_v3:parallel_env"]
)
def test_particles_of_mpe2_are_where_its_world_has_them(spec: str) -> None:
    """By our file of scenes: agents by their observations, landmarks as seen from one of them."""
    drawing, env = drawing_of(spec), first_env(spec)
    world = env.unwrapped.world
    agents = [each.state.p_pos for each in world.agents]
    marks = [each.state.p_pos for each in world.landmarks]
    tracks = [track[0][1:] for track in drawing["tracks"].values()]
    things = [each["track"][0][1:] for each in drawing["scene"]["things"]]
    np.testing.assert_allclose(tracks, agents, atol=1e-3)
    np.testing.assert_allclose(things, marks, atol=2e-3)
    assert all(len(each["track"]) == 1 for each in drawing["scene"]["things"])


def test_board_changes_cell_by_cell() -> None:
    """A board's stones are cells that bear the players' names."""
    drawing = drawing_of("tictactoe")
    (board,) = drawing["scene"]["cells"]
    assert board["values"] == {"1": "player_1", "2": "player_2"}
    assert board["base"] == [0] * 9
    assert [value for _, _, value in board["changes"][:2]] == [1, 2]


def test_scene_does_not_hold_for_other_arguments() -> None:
    """With an argument that it excludes nothing is drawn by it."""
    assert "scene" not in drawing_of("handover", reach=3)
    assert "scene" in drawing_of("handover")


@pytest.mark.parametrize(("spec", "closed"), [("pursuit", "rock"), ("warehouse", "shelf")])
def test_agents_stand_in_cells_that_are_open(spec: str, closed: str) -> None:
    """Places and cells have one frame: rows aren't taken for columns."""
    drawing = drawing_of(spec)
    layer = drawing["scene"]["cells"][0]
    number = next(int(each) for each, word in layer["values"].items() if word == closed)
    shut = {cell for cell, value in enumerate(layer["base"]) if value == number}
    cells = [
        int(y * layer["columns"] + x)
        for track in drawing["tracks"].values()
        for _, x, y in track
        if x is not None
    ]
    assert len(shut) > 0
    assert not shut & set(cells)


def board_at(drawing: Scene, turn: int) -> Any:
    """[rows, columns] numbers of a board's cells."""
    layer = drawing["scene"]["cells"][-1]
    cells = list(layer["base"])
    for at, cell, value in layer["changes"]:
        if at <= turn:
            cells[cell] = value
    return np.array(cells).reshape(layer["rows"], layer["columns"])


BOARDS: dict[str, Any] = {
    "tictactoe_v3": lambda env: np.reshape(env.board.squares, (3, 3)).T,
    "connect_four_v3": lambda env: np.reshape(env.board, (6, 7)),
    "go_v5": lambda env: np.where(env._go.board == -1, 2, env._go.board),
}


@pytest.mark.parametrize("name", BOARDS)
def test_boards_of_pettingzoo_are_as_their_environments_have_them(name: str) -> None:
    """At every turn, whoever observes; the last move is seen, too."""
    kwargs = {"board_size": 5} if name == "go_v5" else {}
    run = gk.rollout(f"classic/{name}", episodes=1, seed=3, env_kwargs=kwargs)
    drawing, episode = packed_of(run, 0)["drawing"], run.episode(0)
    env = gk.make(f"classic/{name}", **kwargs)
    env.reset(seed=episode.seed)
    rows = [row for row in episode.steps.to_pylist() if row["order"] is not None]
    for row in rows:
        seen = board_at(drawing, row["turn"])
        np.testing.assert_array_equal(seen, BOARDS[name](env.unwrapped))
        env.step(row["action"])
    assert len(rows) > 5


def test_pieces_of_chess_stand_on_their_agents_rows() -> None:
    """From the second turn on, whoever observes, white's pieces stand below and black's above."""
    run = gk.rollout("classic/chess_v6", episodes=1, seed=3, most_turns=6)
    drawing = packed_of(run, 0)["drawing"]
    layer = drawing["scene"]["cells"][0]
    for turn in (2, 3):
        rows = board_at(drawing, turn)
        owners = [{layer["values"][str(k)] for k in row if k} for row in rows.tolist()]
        assert (owners[0], owners[7]) == ({"player_1"}, {"player_0"})
        assert layer["pieces"][str(rows[0, 4])] == "king"


@pytest.mark.parametrize(
    ("spec", "size"),
    [("rware:rware-tiny-2ag-v2", [10, 11]), ("lbforaging:Foraging-6x6-2p-1f-v3", [6, 6])],
)
def test_agents_of_registered_ids_are_where_their_environments_have_them(
    spec: str, size: list[int]
) -> None:
    """The pattern that fits the id has the grid's size; x is the column."""
    drawing = drawing_of(spec)
    env = first_env(spec)
    inner = env.guest.env.unwrapped
    bodies = getattr(inner, "agents", None) or inner.players
    places = [[b.x, b.y] if hasattr(b, "x") else list(b.position)[::-1] for b in bodies]
    assert [track[0][1:] for track in drawing["tracks"].values()] == places
    assert drawing["scene"]["size"] == size
