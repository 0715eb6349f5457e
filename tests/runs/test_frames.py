import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from gamekeeper.errors import DependencyError, EvidenceError
from gamekeeper.runs.comparison import replay
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recorder import encode_frame
from gamekeeper.runs.recording import rollout
from tests.runs.walks import Walk


class Shown(Walk):
    """It renders its turn as a text or as a picture."""

    def __init__(self, render_mode: str | None) -> None:
        super().__init__()
        self.render_mode = render_mode

    def render(self) -> Any:
        if self.render_mode == "ansi":
            return f"turn {self.turn}\n"
        return None if self.render_mode is None else np.full((3, 4, 3), self.turn, np.uint8)


@pytest.mark.parametrize("channels", [3, 4])
def test_frame_is_a_picture_without_loss(channels: int) -> None:
    """Pictures are PNG and come back as they were, whatever their memory's order."""
    picture = np.arange(5 * 6 * channels, dtype=np.uint8).reshape(5, 6, channels)

    for frame in (picture, np.asfortranarray(picture), picture[::2, ::-1]):
        suffix, data = encode_frame(frame)

        assert suffix == "png"
        assert np.array_equal(frame, np.asarray(Image.open(io.BytesIO(data))))


@pytest.mark.parametrize(
    "frame",
    [
        np.zeros((2, 2, 5), np.uint8),
        np.zeros((2, 2, 1), np.uint8),
        np.zeros((0, 2, 3), np.uint8),
        np.zeros((2, 2), np.uint8),
        np.zeros((2, 2, 3), np.float32),
        [1, 2],
        {"a": object()},
    ],
)
def test_frame_of_another_kind_is_kept_as_json(frame: Any) -> None:
    """What is neither picture nor text is kept as canonical JSON."""
    suffix, data = encode_frame(frame)

    assert suffix == "json"
    assert data.decode()[0] in "[{"


def test_frame_of_text_is_text() -> None:
    """A text is kept as UTF-8, a lone surrogate as a question mark."""
    assert ("txt", "p.→\n".encode()) == encode_frame("p.→\n")
    assert encode_frame("\ud800") == ("txt", b"?")


def test_frame_needs_pillow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without Pillow a picture is refused with what to install."""
    monkeypatch.setitem(sys.modules, "PIL", None)

    with pytest.raises(DependencyError, match=r"gamekeeper\[frames\]"):
        encode_frame(np.zeros((2, 2, 3), np.uint8))


def test_frames_without_pillow_are_refused_before_the_run_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is left in the way of the next try; the same holds where the mode was chosen."""
    monkeypatch.setitem(sys.modules, "PIL", None)
    for given in ({}, {"render_mode": "rgb_array"}):
        with pytest.raises(DependencyError, match=r"gamekeeper\[frames\]"):
            rollout(
                "two_robot_line", episodes=1, out=tmp_path / "run", frames=True, env_kwargs=given
            )
        assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("mode", "suffix"), [("ansi", "txt"), ("rgb_array", "png")])
def test_frames_of_a_run_are_one_a_turn(tmp_path: Path, mode: str, suffix: str) -> None:
    """A frame for each turn and one at the end, finalized like the rest, not fingerprinted."""
    evidence = rollout(Shown(mode), episodes=2, out=tmp_path / "run", frames=True)

    names = sorted(path.name for path in (tmp_path / "run" / "frames").iterdir())
    assert [f"{e:06d}-{t:06d}.{suffix}" for e in range(2) for t in range(6)] == names
    assert {f"frames/{name}" for name in names} <= set(evidence.manifest["checksums"]["files"])
    assert evidence.fingerprint == rollout(Shown(mode), episodes=2).fingerprint


def test_frames_are_none_where_nothing_is_rendered(tmp_path: Path) -> None:
    """An environment without a render mode leaves no frames, and is recorded as ever."""
    rollout(Shown(None), episodes=1, out=tmp_path / "run", frames=True)

    assert not (tmp_path / "run" / "frames").exists()
    assert load(tmp_path / "run").episode_table.num_rows == 1


def test_frames_choose_a_render_mode_and_record_it(tmp_path: Path) -> None:
    """Who asks for frames need not know render modes; the replay opens the environment likewise."""
    evidence = rollout(
        "two_robot_line", episodes=1, most_turns=3, out=tmp_path / "run", frames=True
    )

    assert evidence.manifest["environment"]["kwargs"] == {"render_mode": "rgb_array"}
    assert {path.suffix for path in (tmp_path / "run" / "frames").iterdir()} == {".png"}
    assert replay(tmp_path / "run").verified


def test_frames_in_a_mode_that_was_chosen_stay_so(tmp_path: Path) -> None:
    """A render mode among the arguments is the user's word."""
    kwargs = {"render_mode": "ansi"}
    rollout(
        "two_robot_line",
        episodes=1,
        most_turns=3,
        out=tmp_path / "run",
        frames=True,
        env_kwargs=kwargs,
    )

    assert {path.suffix for path in (tmp_path / "run" / "frames").iterdir()} == {".txt"}


@pytest.mark.parametrize("modes", [[], ["human"], ["rgb_array"]])
def test_frames_that_cannot_be_taken_are_refused_in_time(tmp_path: Path, modes: list[str]) -> None:
    """No run without the frames that were asked for: no mode, or a factory that takes none."""

    def make() -> Walk:
        env = Walk()
        env.render_mode = None
        env.metadata = {**Walk.metadata, "render_modes": modes}
        return env

    with pytest.raises(EvidenceError, match="no frames can be taken"):
        rollout(make, episodes=1, out=tmp_path / "run", frames=True)
    assert not (tmp_path / "run").exists()
