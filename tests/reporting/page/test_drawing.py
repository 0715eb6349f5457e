"""What is drawn of an episode is what the evidence shows, the best that there is."""

import base64
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

import gamekeeper as gk
from gamekeeper.reporting.page.packed_values import data_url, png
from gamekeeper.reporting.page.player_drawing import DIGEST, Drawing, drawn
from tests.reporting.page.games import PLAIN, Told, recorded


class Seeing(Told):
    """The same, but its infos tell nothing and its observations are of a given space."""

    def __init__(self, space: Any, make: Any, state: Any = None) -> None:
        super().__init__()
        self.make, self.told = make, state
        self.observation_spaces = dict.fromkeys(self.possible_agents, space)
        if state is not None:
            self.state_space = Box(-9, 9, np.shape(state(0)), np.float32)

    def observe(self, agent: Any) -> Any:
        """As it was given."""
        return self.make(self.now)

    def info(self, agent: Any) -> dict[str, Any]:
        """Nothing."""
        return {}

    def state(self) -> Any:
        """As it was given; else there is none."""
        if self.told is None:
            raise NotImplementedError
        return self.told(self.now)


def drawing(env: Any, **options: Any) -> tuple[Any, str]:
    """What is drawn of one episode."""
    episode = gk.rollout(env, episodes=1, **options).episode(0)
    return drawn(episode, PLAIN)


def test_positions_in_infos_are_a_map() -> None:
    """Agents that are told where they are stand on a map, each move once."""
    found, source = drawn(recorded(episodes=1).episode(0), PLAIN)
    assert (found["kind"], source) == ("map", "positions in infos")
    assert set(PLAIN) == set(found["tracks"])
    turns = [turn for turn, _, _ in found["tracks"]["one_0"]]
    assert sorted(turns) == turns
    low_x, high_x, low_y, high_y = found["extent"]
    for track in found["tracks"].values():
        assert all(low_x <= x <= high_x and low_y <= y <= high_y for _, x, y in track)


def test_one_number_is_a_place_on_a_line() -> None:
    """The robots on a line are drawn, each on a line of its own."""
    found, _ = drawn(gk.rollout("two_robot_line", episodes=1).episode(0), ["picker", "carrier"])
    assert found["kind"] == "map"
    assert [{0}, {1}] == [{y for _, _, y in track} for track in found["tracks"].values()]


def test_positions_in_observations_are_a_map() -> None:
    """A leaf called `pos` of two numbers says where an agent is."""
    space = Dict({"pos": Box(-9, 9, (2,), np.float32), "id": Discrete(3)})
    env = Seeing(space, lambda now: {"pos": np.array([now, 1], np.float32), "id": np.int64(1)})
    found, source = drawing(env)
    assert (found["kind"], source) == ("map", "positions in observations")
    assert found["tracks"]["one_0"][:2] == [[0, 0.0, 1.0], [1, 1.0, 1.0]]


def test_observations_become_shades() -> None:
    """The least value is 0, the most 255, rows as many as turns."""
    env = Seeing(Box(-9, 9, (2, 3), np.float32), lambda now: np.full((2, 3), now, np.float32))
    found, source = drawing(env)
    assert (found["kind"], source) == ("cells", "observations")
    part = found["parts"][0]
    shades = np.frombuffer(base64.b64decode(part["values"]), np.uint8).reshape(-1, 2, 3)
    told = tuple(part[key] for key in ("name", "shape", "low", "high"))
    assert told == ("one_0", [2, 3], 0.0, 6.0)
    assert len(part["turns"]) == len(shades)
    assert np.round(shades[:, 0, 0] / 255 * 6).tolist() == part["turns"]


def test_state_is_drawn_first() -> None:
    """Where there is a state it is the first part."""
    env = Seeing(
        Box(-9, 9, (3,), np.float32),
        lambda now: np.zeros(3, np.float32),
        lambda now: np.full(4, now, np.float32),
    )
    found, source = drawing(env)
    assert [part["name"] for part in found["parts"]] == ["state", "one_0", "one_1"]
    assert source == "state and observations"


def test_pictures_that_agents_see_are_shown() -> None:
    """8-bit pictures of all agents stand side by side in one PNG a turn."""
    space = Box(0, 255, (16, 20, 3), np.uint8)
    env = Seeing(space, lambda now: np.full((16, 20, 3), 40 * now, np.uint8))
    found, source = drawing(env)
    assert (found["kind"], source) == ("frames", "observations of one_0, one_1")
    body = base64.b64decode(found["images"][3].partition(",")[2])
    image = np.asarray(Image.open(io.BytesIO(body)))
    assert image.shape == (16, 44, 3)
    assert image[3, 3].tolist() == [120, 120, 120]


def test_digests_are_not_drawn(tmp_path: Path) -> None:
    """Where only digests were kept, that is said."""
    env = Seeing(Box(-9, 9, (3,), np.float32), lambda now: np.zeros(3, np.float32))
    assert drawing(env, level="digest", out=tmp_path / "run") == (None, DIGEST)


def test_long_episodes_leave_turns_out_and_say_so() -> None:
    """Shades have a bound; of more every k-th is kept."""
    env = Seeing(Box(-9, 9, (4000,), np.float32), lambda now: np.full(4000, now, np.float32))
    env.length = 60
    found, source = drawing(env)
    assert "observations, every " in source
    assert sum(len(part["values"]) for part in found["parts"]) < 4 * 200_000


def test_recorded_frames_come_first() -> None:
    """Frames are shown before anything else, letters as letters."""
    episode = recorded(episodes=1).episode(0)
    pictures, _ = drawn(episode, PLAIN, frames=Drawing({2: "data:b", 0: "data:a"}))
    letters, _ = drawn(episode, PLAIN, frames=Drawing({0: "..#"}, is_text=True))
    assert pictures == {"kind": "frames", "images": ["data:a", "data:b"], "at": [0, 2]}
    assert letters == {"kind": "text", "texts": ["..#"], "at": [0]}


SIDES = st.integers(1, 9)


@given(arrays(np.uint8, st.tuples(SIDES, SIDES, st.sampled_from([1, 3, 4]))))
def test_png_is_read_back_as_it_was(pixels: NDArray[np.uint8]) -> None:
    """Pillow reads exactly the pixels that were written."""
    image = np.asarray(Image.open(io.BytesIO(png(pixels))))
    assert np.array_equal(image.reshape(pixels.shape), pixels)
    assert data_url(png(pixels)).startswith("data:image/png;base64,iVBOR")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_have_a_shade(value: float) -> None:
    """NaN and infinities don't spoil the scale of the others."""
    env = Seeing(
        Box(-np.inf, np.inf, (2,), np.float32), lambda now: np.array([value, now], np.float32)
    )
    found, _ = drawing(env)
    assert (found["parts"][0]["low"], found["parts"][0]["high"]) == (0.0, 6.0)
