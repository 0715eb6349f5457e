import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import fs

from gamekeeper.errors import RunError
from gamekeeper.rollouts.executors.storage import Storage


def storages(folder: Path) -> dict[str, Storage]:
    """One storage of each kind that needs no network."""
    mock, root = fs.FileSystem.from_uri("mock:///bucket/runs")
    below = folder / "below"
    below.mkdir(exist_ok=True)
    return {
        "folder": Storage.at(folder / "plain folder"),
        "file": Storage.at((folder / "by url").as_uri()),
        "subtree": Storage(fs.SubTreeFileSystem(str(below), fs.LocalFileSystem()), ""),
        "memory": Storage(mock, root),
    }


KINDS = ["folder", "file", "subtree", "memory"]


@pytest.fixture(params=KINDS)
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> Storage:
    """A storage with nothing in it."""
    return storages(tmp_path)[request.param]


def test_storage_gives_back_what_was_put(storage: Storage) -> None:
    """A file is there whole, over what was there before, and then gone."""
    assert storage.names() == []
    assert not storage.exists("parts/a.json")
    storage.put("parts/a.json", b"one")
    storage.put("parts/a.json", b"two")
    storage.put("plan.json", b"")
    assert storage.get("parts/a.json") == b"two"
    assert storage.exists("parts")
    assert (storage.names(), storage.names("parts")) == (["parts", "plan.json"], ["a.json"])
    storage.delete("parts/a.json")
    storage.delete("parts/a.json")
    assert not storage.exists("parts/a.json")
    storage.delete("parts")
    assert storage.names() == ["plan.json"]
    assert storage.names("parts") == []


def test_folders_go_there_and_come_back(storage: Storage, tmp_path: Path) -> None:
    """Every file of a folder of folders comes back as it was."""
    source = tmp_path / "source"
    (source / "frames").mkdir(parents=True)
    (source / "manifest.json").write_bytes(b"{}")
    (source / "frames" / "000000-000001.png").write_bytes(os.urandom(3_000_000))
    (source / "empty").write_bytes(b"")
    storage.put_folder("parts/k.1", source)
    storage.fetch_folder("parts/k.1", tmp_path / "back")
    found, expected = (
        {path.relative_to(each): path.read_bytes() for path in each.rglob("*") if path.is_file()}
        for each in (tmp_path / "back", source)
    )
    assert found == expected
    storage.delete("parts/k.1")
    assert storage.names("parts") == []


@pytest.mark.parametrize(
    "name", ["", "/etc", "..", "a/../b", "a//b", "a/", ".hidden", "a\\b", "a b", "c:/x", "ä"]
)
def test_names_that_leave_the_storage_are_refused(storage: Storage, name: str) -> None:
    """No name leads out of the storage or to a draft, whatever is done with it."""
    for act in (storage.get, storage.exists, storage.delete, lambda n: storage.put(n, b"")):
        with pytest.raises(RunError, match="name"):
            act(name)


def test_links_in_a_folder_are_not_followed(tmp_path: Path) -> None:
    """A link that somebody laid into the storage leads nowhere."""
    storage = Storage.at(tmp_path / "s")
    storage.put("a", b"1")
    (tmp_path / "s" / "parts").symlink_to(tmp_path)
    with pytest.raises(RunError, match="link"):
        storage.put("parts/x", b"")
    assert not (tmp_path / "x").exists()


@given(st.binary(max_size=3_000), st.integers(0, 3))
def test_bytes_are_kept_exactly(data: bytes, kind: int) -> None:
    """Whatever the bytes, and wherever they lie."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        storage = storages(Path(folder))[KINDS[kind]]
        storage.put("a/b", data)
        assert storage.get("a/b") == data


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_drafts_are_never_seen(kind: str, tmp_path: Path) -> None:
    """Half a file has no name: what was being written when its writer died isn't listed."""
    storage = storages(tmp_path)[kind]
    storage.put("a", b"1")
    lying = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert [path.name for path in lying] == ["a"]
    lying[0].with_name(".0123.b").write_bytes(b"ha")
    assert storage.names() == ["a"]


def test_refusals_name_the_place_without_its_secrets(tmp_path: Path) -> None:
    """An error says where and what to do; user and password of a URL stay out of it."""
    with pytest.raises(RunError) as caught:
        Storage.at("nosuch://me:secret@host/bucket?key=secret")
    assert "nosuch://host/bucket" in str(caught.value)
    assert "secret" not in str(caught.value)
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(RunError, match="writing a failed") as caught:
        Storage.at(blocked).put("a", b"")
    assert caught.value.fix
    with pytest.raises(RunError, match="reading a failed"):
        Storage.at(tmp_path).get("a")


def test_place_opens_it_again_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A relative path means the same to a worker that stands elsewhere."""
    monkeypatch.chdir(tmp_path)
    here = Storage.at("parts here")
    here.put("a", b"1")
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert Storage.at(here.place).get("a") == b"1"
    assert here.path_of("a") == tmp_path / "parts here" / "a"
    assert storages(tmp_path)["file"].path_of("a") is None
