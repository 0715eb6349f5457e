from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EnvError, EvidenceError, RunError, SpecError
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import Done
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs.parts import fan_out as apart
from gamekeeper.runs.parts.part_plan import FOLDER, key_of, parts_folder
from gamekeeper.runs.parts.part_tasks import part_task
from gamekeeper.runs.parts.receipts import receipt_of
from gamekeeper.runs.run_check import verify
from tests.runs.parts.here import CROWD, Here, apart_into, die, plan, tasks_run_here
from tests.runs.walks import TURNS

__all__ = ["tasks_run_here"]

pytestmark = pytest.mark.usefixtures("tasks_run_here")
WALKS = f"{Path(__file__).parents[1] / 'walks.py'}"


def plain(out: Path, **changed: Any) -> Evidence:
    """The same plan recorded by one process, as far as it gets."""
    wanted = plan(**changed)
    options: dict[str, Any] = {
        name: getattr(wanted, name)
        for name in ("env_kwargs", "episodes", "seed", "options", "level", "frames", "most_turns")
    }
    try:
        return gk.rollout(wanted.spec, policies=wanted.policies, out=out, **options)
    except EnvError:
        return gk.load(out)


def assert_same(one: Evidence, run: Path) -> None:
    """Fingerprints, every turn of every episode, header, timing and frame."""
    other = gk.load(run)
    for name in ("fingerprint", "info_fingerprint", "status", "agents", "spaces", "contract"):
        assert one.manifest[name] == other.manifest[name], name
    assert gk.diff(one, other) is None
    found = verify(run, fingerprint=one.fingerprint)
    assert found.ok, str(found)
    drop = ["error"]
    assert one.episode_table.drop_columns(drop).equals(other.episode_table.drop_columns(drop))
    for a, b in zip(one.episodes, other.episodes, strict=True):
        for x, y in zip(a.turns, b.turns, strict=True):
            assert str(x.observations) == str(y.observations)
            assert (x.actions, x.rewards, x.infos) == (y.actions, y.rewards, y.infos)
            assert str(x.state) == str(y.state)
    pair = one.timings, other.timings
    assert pair[0] is not None
    assert pair[1] is not None
    assert pair[0].num_rows == pair[1].num_rows
    assert _frames(Path(str(one.path))) == _frames(run)


def _frames(run: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (run / "frames").glob("*")}


@pytest.mark.parametrize(
    ("order", "changed"),
    [
        (None, {}),
        (0, {}),
        (1, {"spec": f"{WALKS}:Walk", "options": {"start": 5}, "most_turns": TURNS - 1}),
        (2, {"spec": f"{WALKS}:Turns", "policies": {"a": "first-legal", "b": "random"}}),
        (3, {"level": "digest"}),
        (4, {"frames": True, "episodes": 3}),
        (5, {"episodes": 70}),
    ],
    ids=["crowd", "out of order", "walk", "turns", "digest", "frames", "many"],
)
def test_parts_merge_into_what_one_process_records(
    order: int | None, changed: dict[str, Any], tmp_path: Path
) -> None:
    """Whatever the order in which parts are played, the run is the one of a plain recording."""
    one = plain(tmp_path / "one", **changed)
    done = apart_into(tmp_path / "many", plan(**changed), Here(order))
    assert (done.error, done.found, done.deaths) == (None, 0, 0)
    assert_same(one, tmp_path / "many")
    assert not parts_folder(tmp_path / "many").exists()
    if len(changed) < 2:
        assert gk.replay(tmp_path / "many", allow_import=True).verified


KEEPER = """
class Keeper:
    calls = 0

    def __call__(self, observation, agent, info, rng):
        self.calls += 1
        return int(self.calls > 2)


keeper = Keeper()
"""


def test_an_episode_that_depends_on_those_before_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By one that is played again after another, or alone where its part holds several."""
    leaks = plan(episodes=8, env_kwargs={"leaks": True})
    assert "one process would record" in str(apart_into(tmp_path / "leaks", leaks).note)
    assert apart_into(tmp_path / "sound", plan(episodes=8)).note is None
    monkeypatch.setattr("gamekeeper.rollouts.rollout_plan.PARTS", 4)
    (tmp_path / "keeper.py").write_text(KEEPER)
    keeps = plan(episodes=8, policies={"*": f"{tmp_path / 'keeper.py'}:keeper"})
    assert apart_into(tmp_path / "keeps", keeps).depends == 1


def test_columns_of_late_joiners_find_their_places(tmp_path: Path) -> None:
    """Guests that see alike share a column, though in each part another of them came first."""
    apart_into(tmp_path / "many", plan(episodes=12))
    one = plain(tmp_path / "one", episodes=12)
    steps = gk.load(tmp_path / "many").agent_steps
    assert sorted(steps.schema.names) == sorted(one.agent_steps.schema.names)
    assert len([name for name in steps.schema.names if name.startswith("obs")]) == 4


@pytest.mark.parametrize("order", [None, 2, 5])
def test_first_failure_ends_the_run_as_in_one_process(order: int | None, tmp_path: Path) -> None:
    """Episodes after the first that failed don't count, though some of them were played."""
    fails = [episode_seed(3, episode) for episode in (2, 4)]
    one = plain(tmp_path / "one", env_kwargs={"fails": fails})
    executor = Here(order, most=6)
    done = apart_into(tmp_path / "many", plan(env_kwargs={"fails": fails}), executor)
    assert isinstance(done.error, EnvError)
    assert "the crowd is stuck" in done.error.what
    assert (done.parts, one.manifest["status"]) == (3, "failed")
    assert_same(one, tmp_path / "many")
    last = gk.load(tmp_path / "many").episode_table.to_pylist()[-1]
    assert (last["episode"], last["end"]) == (2, "failed")
    assert "the crowd is stuck" in last["error"]
    assert not parts_folder(tmp_path / "many").exists()


def test_stopped_recording_goes_on_where_it_was(tmp_path: Path) -> None:
    """Parts that are whole are not played again, and the run is the same."""
    with pytest.raises(KeyboardInterrupt):
        apart_into(tmp_path / "many", plan(), Here(1, stop=4))
    assert not (tmp_path / "many").exists()
    with pytest.raises(RunError, match="another recording"):
        apart_into(tmp_path / "many", plan(seed=9))
    executor = Here()
    done = apart_into(tmp_path / "many", plan(), executor)
    assert (done.found, len(executor.played)) == (4, 2)
    assert_same(plain(tmp_path / "one"), tmp_path / "many")


def test_death_of_what_merges_is_told_and_the_same_command_merges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parts stay whole, nothing lies where the run should, and none is played again."""
    with monkeypatch.context() as killed:
        killed.setattr(apart, "run_task", run_task)
        killed.setattr(apart, "MERGE", f"{die.__module__}:{die.__name__}")
        with pytest.raises(RunError, match="merges the parts ended") as told:
            apart_into(tmp_path / "many", plan())
    assert "killed by SIGKILL" in told.value.actual
    assert "the same command merges them" in told.value.fix
    assert not (tmp_path / "many").exists()
    executor = Here()
    apart_into(tmp_path / "many", plan(), executor)
    assert executor.played == []
    assert_same(plain(tmp_path / "one"), tmp_path / "many")


def test_failure_found_again_ends_the_run(tmp_path: Path) -> None:
    """A recording that goes on after a failure was seen still ends there."""
    changed = {"env_kwargs": {"fails": [episode_seed(3, 1)]}}
    with pytest.raises(KeyboardInterrupt):
        apart_into(tmp_path / "many", plan(**changed), Here(None, stop=2))
    executor = Here()
    done = apart_into(tmp_path / "many", plan(**changed), executor)
    assert isinstance(done.error, EnvError)
    assert executor.played == []
    assert_same(plain(tmp_path / "one", **changed), tmp_path / "many")


def test_two_attempts_at_a_part_never_mix(tmp_path: Path) -> None:
    """An attempt that nobody heard of any more leaves rubbish, and no second copy."""
    storage = Storage.at(parts_folder(tmp_path / "many"))
    with pytest.raises(KeyboardInterrupt):
        apart_into(tmp_path / "many", plan(), Here(stop=0))
    given = {"storage": storage.place, "plan": plan().to_json(), "first": 0, "stop": 1}
    first = part_task(lambda **fields: None, **given)
    receipt = receipt_of(storage, key_of(range(1)))
    assert receipt is not None
    storage.delete(f"{FOLDER}/{receipt.key}.json")
    again = part_task(lambda **fields: None, **given)
    assert first == again
    other = receipt_of(storage, key_of(range(1)))
    assert other is not None
    assert other.folder != receipt.folder
    assert storage.exists(receipt.folder)
    assert part_task(lambda **fields: None, **given) == again
    done = apart_into(tmp_path / "many", plan())
    assert done.found == 1
    assert_same(plain(tmp_path / "one"), tmp_path / "many")


def lost(path: Path) -> None:
    path.unlink()


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def halved(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def zeroed(path: Path) -> None:
    """Its length was on the disk, its last bytes weren't."""
    size = path.stat().st_size
    path.write_bytes(path.read_bytes()[: size // 2] + bytes(size - size // 2))


def changed(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("harm", [lost, emptied, halved, zeroed, changed])
@pytest.mark.parametrize("name", ["manifest.json", "agent_steps.parquet", "episodes.parquet"])
def test_damaged_part_is_played_again(
    name: str, harm: Callable[[Path], None], tmp_path: Path
) -> None:
    """Parts aren't synced: what a power cut left of one is compared with its checksums."""
    storage = Storage.at(parts_folder(tmp_path / "many"))
    with pytest.raises(KeyboardInterrupt):
        apart_into(tmp_path / "many", plan(), Here(stop=5))
    harm(_file(storage, range(2, 3), name))
    executor = Here()
    done = apart_into(tmp_path / "many", plan(), executor)
    assert (done.found, done.torn) == (4, 1)
    assert executor.played == [key_of(range(5, 6)), key_of(range(2, 3))]
    assert_same(plain(tmp_path / "one"), tmp_path / "many")
    assert not parts_folder(tmp_path / "many").exists()


@pytest.mark.parametrize("harm", [lost, emptied, halved, zeroed])
def test_torn_receipt_is_none(harm: Callable[[Path], None], tmp_path: Path) -> None:
    """Nor are receipts synced: the part of one that a power cut tore is played again."""
    with pytest.raises(KeyboardInterrupt):
        apart_into(tmp_path / "many", plan(), Here(stop=5))
    key = key_of(range(2, 3))
    harm(parts_folder(tmp_path / "many") / FOLDER / f"{key}.json")
    executor = Here()
    assert apart_into(tmp_path / "many", plan(), executor).found == 4
    assert executor.played == [key, key_of(range(5, 6))]
    assert_same(plain(tmp_path / "one"), tmp_path / "many")


def test_torn_failure_ends_the_run_all_the_same(tmp_path: Path) -> None:
    """A part that failed, and was damaged then, fails again; nothing behind it is played."""
    changed_ = {"env_kwargs": {"fails": [episode_seed(3, 1)]}}
    storage = Storage.at(parts_folder(tmp_path / "many"))
    with pytest.raises(KeyboardInterrupt):
        apart_into(tmp_path / "many", plan(**changed_), Here(None, stop=2, most=2))
    zeroed(_file(storage, range(1, 2), "episodes.parquet"))
    done = apart_into(tmp_path / "many", plan(**changed_))
    assert isinstance(done.error, EnvError)
    assert (done.parts, done.torn) == (2, 1)
    assert_same(plain(tmp_path / "one", **changed_), tmp_path / "many")


def test_part_that_is_damaged_again_is_told(tmp_path: Path) -> None:
    """Whatever damages it, it is no power cut: nothing is played without end."""
    storage = Storage.at(parts_folder(tmp_path / "many"))

    class Harmed(Here):
        def map(self, *given: Any, **options: Any) -> Iterator[Done]:
            yield from super().map(*given, **options)
            changed(_file(storage, range(2, 3), "agent_steps.parquet"))

    executor = Harmed()
    with pytest.raises(RunError, match="a part was changed") as caught:
        apart_into(tmp_path / "many", plan(), executor)
    assert key_of(range(2, 3)) in caught.value.where
    assert executor.played.count(key_of(range(2, 3))) == 2
    assert len(executor.played) == 7
    assert not (tmp_path / "many").exists()
    assert apart_into(tmp_path / "many", plan()).torn == 1


def _file(storage: Storage, episodes: range, name: str) -> Path:
    """A file of a part that is whole."""
    receipt = receipt_of(storage, key_of(episodes))
    assert receipt is not None
    path = storage.path_of(f"{receipt.folder}/{name}")
    assert path is not None
    return path


def test_parts_go_by_url_and_come_back(tmp_path: Path) -> None:
    """Where storage is no folder of this machine, parts are sent there and fetched again."""
    place = tmp_path / "far away"
    done = apart_into(tmp_path / "many", plan(frames=True), Here(2), Storage.at(place.as_uri()))
    assert done.error is None
    assert_same(plain(tmp_path / "one", frames=True), tmp_path / "many")
    assert [path for path in place.rglob("*") if path.is_file()] == []


def test_taken_folder_is_refused_before_anything_is_played(tmp_path: Path) -> None:
    """Nobody waits for hours to hear that there is no room for the result."""
    (tmp_path / "many").mkdir()
    (tmp_path / "many" / "mine.txt").write_text("keep")
    executor = Here()
    with pytest.raises(RunError, match="isn't empty"):
        apart_into(tmp_path / "many", plan(), executor)
    assert executor.played == []
    assert not parts_folder(tmp_path / "many").exists()


def test_link_to_an_empty_folder_is_followed(tmp_path: Path) -> None:
    """The run lies where the link leads, and the link stays."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "many").symlink_to(tmp_path / "disk")
    assert apart_into(tmp_path / "many", plan(episodes=2)).error is None
    assert (tmp_path / "many").is_symlink()
    assert (tmp_path / "disk" / "manifest.json").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "many"]


def test_mounted_disk_is_refused_before_anything_is_played(tmp_path: Path) -> None:
    """A folder that can't be replaced in one step is told while that costs nothing."""
    executor = Here()
    storage = Storage.at(tmp_path / "parts")
    with pytest.raises(RunError, match="mounted disk"):
        apart_into(Path("/"), plan(), executor, storage)
    assert (executor.played, (tmp_path / "parts").exists()) == ([], False)


def test_mistake_leaves_nothing_that_is_in_the_way(tmp_path: Path) -> None:
    """A wrong name is told as in one process, and the fixed command isn't refused."""
    with pytest.raises(SpecError):
        apart_into(tmp_path / "many", plan(spec="no.such:env"))
    assert not parts_folder(tmp_path / "many").exists()
    assert apart_into(tmp_path / "many", plan()).error is None


def test_environment_of_other_code_is_refused(tmp_path: Path) -> None:
    """Parts played before the rules were changed don't go into one run with those after it."""
    text = Path(CROWD.rpartition(":")[0]).read_text(encoding="utf-8")
    file = tmp_path / "rules.py"
    file.write_text(text, encoding="utf-8")
    wanted = plan(spec=f"{file}:Crowd")
    with pytest.raises(KeyboardInterrupt):
        apart_into(tmp_path / "many", wanted, Here(stop=3))
    file.write_text(text + "# changed\n", encoding="utf-8")
    with pytest.raises(RunError, match="isn't of the same environment") as caught:
        apart_into(tmp_path / "many", wanted)
    assert "source_digest" in caught.value.where


def test_progress_counts_all_parts_together(tmp_path: Path) -> None:
    """Episodes never run backwards and end at all of them; then parts are merged."""
    said: list[dict[str, Any]] = []
    from gamekeeper.runs.parts.fan_out import record_apart

    record_apart(
        plan(),
        tmp_path / "many",
        executor=Here(3),
        on_message=said.append,
        storage=Storage.at(parts_folder(tmp_path / "many")),
    )
    episodes = [each["episode"] for each in said if "episode" in each]
    assert episodes == sorted(episodes)
    assert episodes[-1] == 6
    assert [each["episodes"] for each in said if "episodes" in each][-1] == 6
    assert max(each.get("turns", 0) for each in said) == 24


@pytest.mark.parametrize(
    ("given", "where"),
    [
        ({"spec": object()}, "spec"),
        ({"policies": {"host": lambda observation: 0}}, "policies['host']"),
        ({"contract": gk.Contract()}, "contract"),
        ({"out": None}, "out"),
        ({"first": 2}, "first"),
    ],
)
def test_objects_are_refused_to_workers(given: dict[str, Any], where: str, tmp_path: Path) -> None:
    """What can't be named can't be opened by another process; the fix says so."""
    usual: dict[str, Any] = {"spec": CROWD, "out": tmp_path / "run", "episodes": 1, "workers": 1}
    with pytest.raises(EvidenceError) as caught:
        gk.rollout(**{**usual, **given})
    assert caught.value.where == where
    assert caught.value.fix
