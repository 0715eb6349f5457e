"""Episodes as films: what is in them, where it comes from, what is refused."""

import io
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.errors import DependencyError, EvidenceError, GamekeeperError, RunError, TrustError
from gamekeeper.viewing.video_file import (
    VideoRendering,
    _short,
    captions_of,
    film,
    picture_of,
    size_for,
)
from gamekeeper.viewing.video_frames import recorded
from tests.cli.lines import LINE, document, said
from tests.surface.sources import ROOT

Image = pytest.importorskip("PIL.Image")
ffmpeg = pytest.importorskip("imageio_ffmpeg")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two episodes with their frames."""
    folder = tmp_path_factory.mktemp("film") / "run"
    gk.rollout("two_robot_line", episodes=2, seed=3, frames=True, out=folder)
    return folder


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same without frames."""
    folder = tmp_path_factory.mktemp("film") / "bare"
    gk.rollout("two_robot_line", episodes=2, seed=3, out=folder)
    return folder


def played(path: Path) -> tuple[str, list[np.ndarray]]:
    """What a player reads of an mp4: its own words on the picture's stream, and the frames."""
    words = ["-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run([ffmpeg.get_ffmpeg_exe(), *words], capture_output=True, check=True)
    told = re.search(r"Video: .*", done.stderr.decode())
    assert told is not None
    size = re.search(r", (\d+)x(\d+)", told[0])
    assert size is not None
    wide, high = map(int, size.groups())
    return told[0], list(np.frombuffer(done.stdout, np.uint8).reshape(-1, high, wide, 3))


def test_film_shows_every_recorded_frame(run: Path, tmp_path: Path) -> None:
    """An mp4 that browsers play and a gif, as many frames in each as were recorded."""
    found = film(run, tmp_path, episode=1, fps=20)
    count = len(recorded(gk.load(run))[1])
    told = (found.frames, found.source, found.fps, found.divergence)
    assert told == (count, "recorded", 20, None)
    mp4, gif = map(Path, found.paths)
    assert (mp4.name, gif.name) == ("run-episode-1.mp4", "run-episode-1.gif")
    words, frames = played(mp4)
    for word in ("h264", "yuv420p", f"{found.size[0]}x{found.size[1]}", "20 fps"):
        assert word in words
    assert len(frames) == count
    with Image.open(gif) as animation:
        assert (animation.n_frames, animation.size) == (count, found.size)
        assert (animation.info["duration"], animation.info["loop"]) == (50, 0)
    assert {path.name for path in tmp_path.iterdir()} == {mp4.name, gif.name}


def test_film_colours_are_those_of_the_frames(run: Path, tmp_path: Path) -> None:
    """What is played is near what was rendered, pixel by pixel, enlarged by a whole number."""
    found = film(run, tmp_path / "x.mp4", episode=0, has_strip=False)
    _, frames = played(Path(found.paths[0]))
    for frame, (_, path) in zip(frames, recorded(gk.load(run))[0], strict=True):
        picture = np.asarray(picture_of(path))
        scale = found.size[0] // picture.shape[1]
        large = picture.repeat(scale, 0).repeat(scale, 1).astype(int)
        near = np.abs(frame[: large.shape[0], : large.shape[1]].astype(int) - large)
        assert np.mean(near) < 4


def test_film_renders_what_was_played(run: Path, bare: Path, tmp_path: Path) -> None:
    """A replay's frames are the recorded ones, bit for bit; its rate is the environment's own."""
    found = film(bare, tmp_path / "again.gif", episode=1, rendering=VideoRendering())
    first = film(run, tmp_path / "first.gif", episode=1, fps=found.fps)
    assert (found.source, found.divergence, found.frames) == ("rendered", None, first.frames)
    assert found.fps != 10
    assert Path(found.paths[0]).read_bytes() == Path(first.paths[0]).read_bytes()


def test_film_says_where_its_replay_differs(tmp_path: Path) -> None:
    """An environment that changed is filmed as it is now, and the first difference is named."""
    source = ROOT / "examples" / "two_robot_line.py"
    (tmp_path / "line.py").write_text(source.read_text())
    spec = f"{tmp_path / 'line.py'}:make"
    gk.rollout(spec, episodes=1, out=tmp_path / "run")
    (tmp_path / "line.py").write_text(source.read_text().replace("MEETING if met", "2.0 if met"))
    found = film(tmp_path / "run", tmp_path / "x.gif", rendering=VideoRendering(env=spec))
    assert found.divergence is not None
    assert "reward" in found.divergence


@pytest.mark.parametrize("render", [False, True])
def test_film_needs_frames_or_a_replay(bare: Path, tmp_path: Path, render: bool) -> None:
    """A run without frames is refused with the way out; an episode that isn't there as well."""
    if not render:
        with pytest.raises(EvidenceError, match="has no frames") as caught:
            film(bare, tmp_path)
        assert "--render" in caught.value.fix
    with pytest.raises(EvidenceError, match="no episode 9"):
        film(bare, tmp_path, episode=9, rendering=VideoRendering() if render else None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("nothing_is_ours")
def test_film_runs_no_code_that_evidence_names(tmp_path: Path) -> None:
    """An environment in a file is rendered only where that is allowed, or named anew."""
    gk.rollout(LINE, episodes=1, out=tmp_path / "run")
    with pytest.raises(TrustError, match="would execute code"):
        film(tmp_path / "run", tmp_path / "x.gif", rendering=VideoRendering())
    assert not (tmp_path / "x.gif").exists()
    found = film(tmp_path / "run", tmp_path / "x.gif", rendering=VideoRendering(env=LINE))
    assert found.frames == gk.load(tmp_path / "run").episode_table["turns"].to_pylist()[0] + 1


def test_film_takes_frames_of_all_kinds(tmp_path: Path) -> None:
    """Odd sizes, see-through pictures and texts come to one even size."""
    path = tmp_path / "run"
    run_files(
        path,
        {
            "000000-000000.png": png((7, 5, 3)),
            "000000-000001.png": png((9, 5, 4)),
            "000000-000002.txt": "é| a  b\n |".encode(),
            "000000-000003.json": b"{}",
            "note.txt": b"not a frame",
        },
    )
    found = film(path, tmp_path / "x.mp4", has_strip=False)
    told, frames = played(tmp_path / "x.mp4")
    assert found.frames == len(frames) == 3
    assert f"{found.size[0]}x{found.size[1]}" in told
    assert all(side % 2 == 0 for side in found.size)


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n", b"GIF89a", None])
def test_film_refuses_a_damaged_frame(data: bytes | None, tmp_path: Path) -> None:
    """The file is named, and no half film is left."""
    broken = png((99, 99, 3))[:99] if data is None else data
    run_files(tmp_path / "run", {"000000-000000.png": png((9, 9, 3)), "000000-000001.png": broken})
    (tmp_path / "out").mkdir()
    with pytest.raises(RunError, match=r"000000-000001\.png"):
        film(tmp_path / "run", tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_film_follows_no_link(tmp_path: Path) -> None:
    """A frame that is a link to another file isn't shown."""
    run_files(tmp_path / "run", {"000000-000000.png": png((9, 9, 3))})
    secret = tmp_path / "secret.png"
    secret.write_bytes(png((9, 9, 3)))
    (tmp_path / "run" / "frames" / "000000-000001.png").symlink_to(secret)
    with pytest.raises(RunError, match="link"):
        film(tmp_path / "run", tmp_path / "x.gif")


def test_film_replaces_an_earlier_one(run: Path, tmp_path: Path) -> None:
    """A file is overwritten, a folder isn't; names of other forms are refused."""
    (tmp_path / "x.gif").write_text("earlier")
    film(run, tmp_path / "x.gif")
    assert (tmp_path / "x.gif").read_bytes()[:3] == b"GIF"
    (tmp_path / "y.gif").mkdir()
    with pytest.raises(RunError, match="a folder has this name"):
        film(run, tmp_path / "y.gif")
    with pytest.raises(GamekeeperError, match="known video format"):
        film(run, tmp_path / "x.avi")


@pytest.mark.parametrize(("package", "form"), [("imageio_ffmpeg", "mp4"), ("PIL", "gif")])
def test_film_names_the_extra_that_is_missing(
    package: str, form: str, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is played or written."""
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(DependencyError, match="isn't installed") as caught:
        film(run, tmp_path / f"x.{form}", rendering=VideoRendering())
    assert "pip install 'gamekeeper[video]'" in caught.value.fix
    assert list(tmp_path.iterdir()) == []


def test_strips_tell_who_did_what_and_was_paid(run: Path) -> None:
    """Below the frame of a turn stands what led to it; the sums are the returns at the end."""
    evidence = gk.load(run)
    episode = evidence.episode(0)
    captions = captions_of(episode)
    assert captions[0][0] == "episode 0, turn 0"
    last = captions[max(recorded(evidence)[0])[0]]
    for line, (name, total) in zip(last[1:], [("picker", 1.0), ("carrier", 1.0)], strict=True):
        assert line.startswith(name)
        assert line.endswith(f"sum {total:g}")


def test_actions_of_a_dict_space_stand_in_strips_as_numbers() -> None:
    """An array in a dictionary is its values, not the word `array`."""
    assert _short({"x": np.float32(0.5), "y": np.array([1, 2])}) == '{"x":0.5,"y"..'
    assert _short(np.array([1, 2])) == "[1,2]"


def test_sizes_are_even_and_large_enough() -> None:
    """Small frames are enlarged by a whole number; a strip makes room below."""
    assert size_for([(3, 5)], 0, 0) == (192, 320, 64)
    assert size_for([(401, 301)], 0, 0) == (402, 302, 1)
    assert size_for([(401, 301)], 2, 100) == (608, 334, 1)


def test_video_on_the_command_line(
    run: Path, bare: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The document is the film's; exit code 2 where there is nothing to show."""
    code, found = document(capfd, "video", run, "--out", tmp_path / "x.gif", "--no-strip")
    assert (code, found["episode"], found["source"]) == (0, 0, "recorded")
    assert found["paths"] == [str(tmp_path / "x.gif")]
    code, out, err = said(capfd, "video", run, "--out", tmp_path / "y.gif")
    assert (code, err) == (0, "")
    assert out.startswith("Written  episode 0, recorded: ")
    code, out, err = said(capfd, "video", bare, "--out", tmp_path)
    assert (code, out) == (2, "")
    assert "--render" in err


def png(shape: tuple[int, ...]) -> bytes:
    """A picture of that shape."""
    pixels = np.arange(np.prod(shape), dtype=np.uint8).reshape(shape)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def run_files(path: Path, frames: dict[str, bytes]) -> None:
    """A finalized run with these frames."""
    from gamekeeper.runs.files.store import RunStore

    gk.rollout("two_robot_line", episodes=1, out=path.with_name("whole"))
    evidence = gk.load(path.with_name("whole"))
    manifest = {name: value for name, value in evidence.manifest.items() if name != "checksums"}
    store = RunStore.create(path, manifest)
    for stream in ("episodes", "agent_steps"):
        store.append(stream, evidence.tables.table(stream).combine_chunks().to_batches()[0])
    for name, data in frames.items():
        store.write_frame(name, data)
    store.finalize({**manifest, "status": "finalized"})
    shutil.rmtree(path.with_name("whole"))
