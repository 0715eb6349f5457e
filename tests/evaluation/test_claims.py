"""Claims: what is packed is ticked elsewhere, and whatever was changed is named."""

import json
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.cli.reproduce import _unconfirmed
from gamekeeper.errors import RunError
from gamekeeper.evaluation.claim_check import CheckedClaim, reproduce
from gamekeeper.evaluation.claim_pack import CLAIM, digest_of, pack
from gamekeeper.evaluation.evaluator import evaluate
from tests.runs.plays import played, write_env


@pytest.fixture(autouse=True)
def another_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is an own run, and the current folder is empty."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")


def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What one user recorded, another one checks; the recorded file is gone."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "other"))
    (tmp_path / "walks.py").unlink(missing_ok=True)


def altered(claim: Path, name: str, change: Callable[[bytes], bytes], *, hides: bool) -> None:
    """Changes one file of a claim; `hides`: also its digest in the document."""
    with zipfile.ZipFile(claim) as archive:
        contents = {each: archive.read(each) for each in archive.namelist()}
    contents[name] = change(contents[name])
    if hides:
        document = json.loads(contents[CLAIM])
        document["files"][name] = digest_of(contents[name])
        contents[CLAIM] = json.dumps(document).encode()
    with zipfile.ZipFile(claim, "w") as archive:
        for each, data in contents.items():
            archive.writestr(each, data)


def paying_more(text: bytes) -> bytes:
    """The walks, in which the first of three actions is paid as well."""
    return text.replace(b"float(actions.get(agent, 0))", b"float(actions.get(agent, 0)) + 0.5")


def checked(tmp_path: Path, **options: Any) -> CheckedClaim:
    """The claim, checked into a new folder."""
    return reproduce(tmp_path / "claim.zip", tmp_path / "unpacked", **options)


def test_every_figure_is_ticked_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the claim's own source, in a folder and for a user that have nothing of it."""
    played(tmp_path)
    (tmp_path / "model.bin").write_bytes(b"weights")
    packed = pack([tmp_path / "run"], tmp_path / "claim.zip", files=[tmp_path / "model.bin"])
    assert "source/walks.py" in packed.source
    elsewhere(monkeypatch, tmp_path)
    found = checked(tmp_path, allow_import=True)
    assert found.ok is True, found.to_json()
    assert {each.ticked for each in found.figures} == {True}
    assert {"fingerprint", "episodes"} <= {each.name for each in found.figures}
    assert (found.damage, found.differs, found.digest) == ((), (), packed.digest)
    assert (tmp_path / "unpacked/files/model.bin").read_bytes() == b"weights"


def test_nothing_of_a_claim_runs_without_consent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its source lies there and isn't imported: no figure is ticked, and the reason says why."""
    played(tmp_path)
    pack([tmp_path / "run"], tmp_path / "claim.zip")
    elsewhere(monkeypatch, tmp_path)
    mark = tmp_path / "executed"
    altered(
        tmp_path / "claim.zip",
        "source/walks.py",
        lambda text: text + f"\nopen({str(mark)!r}, 'w')\n".encode(),
        hides=True,
    )
    found = checked(tmp_path)
    assert found.ok is None
    assert {each.ticked for each in found.figures} == {None}
    assert "--allow-import" in found.reasons["run"]
    assert not mark.exists()


def test_changed_reward_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rules that pay otherwise: turn, agent and both rewards, and that the source is another."""
    played(tmp_path)
    pack([tmp_path / "run"], tmp_path / "claim.zip")
    elsewhere(monkeypatch, tmp_path)
    altered(tmp_path / "claim.zip", "source/walks.py", paying_more, hides=True)
    found = checked(tmp_path, allow_import=True)
    assert found.ok is False
    where = found.replays["run"].divergence
    assert where is not None
    assert (where.episode, where.turn, where.field) == (0, 0, "reward")
    assert where.recorded != where.replayed
    assert "source of run" in [each.name for each in found.differs]
    said = list(_unconfirmed(found))
    assert len(said) == 1
    assert "figures of run are in the evidence as claimed, but not ticked" in said[0]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The claim of an evaluation: two policies, ten episodes, recorded."""
    folder = tmp_path_factory.mktemp("judged")
    policies = {"random": "random", "first": "first-legal"}
    evaluate(
        f"{write_env(folder)}:Walk",
        policies=policies,
        episodes=10,
        record="digest",
        out=folder / "ev",
    )
    pack([folder / "ev"], folder / "claim.zip")
    return folder / "claim.zip"


def test_every_figure_of_an_evaluation_is_ticked(
    judged: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Means, quantiles, intervals and differences, from runs that replay; one changed is named."""
    elsewhere(monkeypatch, tmp_path)
    (tmp_path / "claim.zip").write_bytes(judged.read_bytes())
    found = checked(tmp_path, allow_import=True)
    assert found.ok is True, found.to_json()
    names = [each.name for each in found.figures if each.run == "ev"]
    assert "results, walks, random, 0, team, return: mean.value" in names
    assert "comparisons, walks, random, first, team, return: difference.value" in names

    def better(text: bytes) -> bytes:
        document = json.loads(text)
        document["results"][0]["mean"]["value"] += 0.25
        return json.dumps(document).encode()

    altered(tmp_path / "claim.zip", "evaluations/ev/evaluation.json", better, hides=True)
    again = reproduce(tmp_path / "claim.zip", tmp_path / "again", allow_import=True)
    wrong = [each for each in again.figures if each.ticked is not True]
    assert [f"{each.name}" for each in wrong] == [names[3]]
    assert (again.ok, wrong[0].claimed - wrong[0].recorded) == (False, 0.25)


def test_figures_of_an_aec_evaluation_are_ticked(tmp_path: Path) -> None:
    """Lengths count decisions, not the empty steps that close the lives of AEC agents."""
    policies = {"random": "random", "first": "first-legal"}
    evaluate("aec:tictactoe", policies=policies, episodes=2, record="digest", out=tmp_path / "ev")
    pack([tmp_path / "ev"], tmp_path / "claim.zip")
    found = checked(tmp_path)
    assert [each for each in found.figures if each.ticked is not True] == []
    assert found.ok is True


def test_evaluation_without_runs_is_refused(tmp_path: Path) -> None:
    """Figures that nothing replays are no claim."""
    out = tmp_path / "ev"
    evaluate(f"{write_env(tmp_path)}:Walk", policies={"r": "random"}, episodes=2, out=out)
    with pytest.raises(RunError, match=r"--record"):
        pack([out], tmp_path / "claim.zip")


def test_changed_source_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of the claim that isn't as packed, and one beside the reader that is another."""
    played(tmp_path)
    pack([tmp_path / "run"], tmp_path / "claim.zip")
    elsewhere(monkeypatch, tmp_path)
    altered(tmp_path / "claim.zip", "source/walks.py", lambda text: text + b"#", hides=False)
    write_env(Path.cwd(), ("TURNS = 5", "TURNS = 4"))
    found = checked(tmp_path)
    assert found.damage == ("source/walks.py: not the file that was packed",)
    assert "walks.py" in [each.name for each in found.differs]
    assert found.ok is False


def test_other_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The version that was claimed beside the one that is here."""
    played(tmp_path)
    pack([tmp_path / "run"], tmp_path / "claim.zip")
    elsewhere(monkeypatch, tmp_path)

    def older(text: bytes) -> bytes:
        document = json.loads(text)
        document["runs"][0]["environment"]["versions"]["numpy"] = "1.0.0"
        return json.dumps(document).encode()

    altered(tmp_path / "claim.zip", CLAIM, older, hides=False)
    found = checked(tmp_path, allow_import=True)
    assert found.ok is True
    assert [f"{each.name} {each.claimed}" for each in found.differs] == ["numpy 1.0.0"]


def test_changed_figure_is_not_ticked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A claim that says more than its evidence."""
    played(tmp_path)
    pack([tmp_path / "run"], tmp_path / "claim.zip")
    elsewhere(monkeypatch, tmp_path)

    def better(text: bytes) -> bytes:
        document = json.loads(text)
        document["runs"][0]["figures"]["episodes"] = 100
        return json.dumps(document).encode()

    altered(tmp_path / "claim.zip", CLAIM, better, hides=False)
    found = checked(tmp_path, allow_import=True)
    assert found.ok is False
    assert [each.name for each in found.figures if not each.ticked] == ["episodes"]


def test_files_of_one_name_are_told_apart(tmp_path: Path) -> None:
    """Checkpoints of two seeds have one name, and both are packed."""
    played(tmp_path)
    named = [tmp_path / seed / "ppo" / "model.zip" for seed in ("0", "1")]
    for number, path in enumerate(named):
        path.parent.mkdir(parents=True)
        path.write_bytes(bytes([number]))
    single = tmp_path / "here" / ".." / "notes.txt"
    single.write_text("read me")
    pack([tmp_path / "run"], tmp_path / "claim.zip", files=[*named, single])
    with zipfile.ZipFile(tmp_path / "claim.zip") as archive:
        kept = {name: archive.read(name) for name in archive.namelist() if "files/" in name}
    assert kept == {
        "files/0/ppo/model.zip": b"\x00",
        "files/1/ppo/model.zip": b"\x01",
        "files/notes.txt": b"read me",
    }


def test_sources_of_one_name_are_refused(tmp_path: Path) -> None:
    """Two environments in files of one name can't both lie in the source."""
    edits = {"one": (), "two": (("TURNS = 5", "TURNS = 4"),)}
    for folder, each in edits.items():
        (tmp_path / folder).mkdir()
        played(tmp_path / folder, *each)
    with pytest.raises(RunError, match="sources of two runs have one name"):
        pack([tmp_path / "one/run", tmp_path / "two/run"], tmp_path / "claim.zip")
    pack([tmp_path / "one/run"], tmp_path / "claim.zip")


def test_only_contracts_are_packed_of_what_lies_beside(tmp_path: Path) -> None:
    """Other TOML files, such as a project's, may hold what isn't meant for others."""
    played(tmp_path)
    (tmp_path / "walks.toml").write_text('name = "walks_v0"\napi = "parallel"\n')
    (tmp_path / "pyproject.toml").write_text('[tool.secrets]\ntoken = "1234"\n')
    packed = pack([tmp_path / "run"], tmp_path / "claim.zip")
    assert "source/walks.toml" in packed.source
    assert "source/pyproject.toml" not in packed.source


def test_broken_entries_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Packed data that can't be unpacked any more, in every file of a run at once."""
    played(tmp_path)
    pack([tmp_path / "run"], tmp_path / "claim.zip")
    data = bytearray((tmp_path / "claim.zip").read_bytes())
    with zipfile.ZipFile(tmp_path / "claim.zip") as archive:
        entries = [each for each in archive.infolist() if each.filename.startswith("runs/")]
    for each in entries:
        first = each.header_offset + 30 + len(each.filename)
        for place in range(first, first + min(each.compress_size, 40)):
            data[place] ^= 0xFF
    (tmp_path / "claim.zip").write_bytes(data)
    elsewhere(monkeypatch, tmp_path)
    found = checked(tmp_path)
    assert found.ok is False
    named = {each.partition(":")[0] for each in found.damage}
    assert {each.filename for each in entries} <= named


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """A folder with two SSH keys, and a file that allows the first."""
    program = shutil.which("ssh-keygen")
    if program is None:
        pytest.skip("OpenSSH's ssh-keygen isn't installed")
    for name in ("ada", "eve"):
        line = [program, "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / name)]
        subprocess.run(line, check=True)
    public = (tmp_path / "ada.pub").read_text()
    (tmp_path / "signers").write_text(f"ada@example.org {public}")
    return tmp_path


def test_signed_claim_names_its_signer(tmp_path: Path, keys: Path) -> None:
    """An allowed signer over these bytes is named; another key or byte is refused unread."""
    played(tmp_path)
    packed = pack([tmp_path / "run"], tmp_path / "claim.zip", sign=keys / "ada")
    assert packed.signature == f"{tmp_path / 'claim.zip'}.sig"
    assert checked(tmp_path, signers=keys / "signers").signer == "ada@example.org"

    with (tmp_path / "claim.zip").open("ab") as file:
        file.write(b"x")
    with pytest.raises(RunError, match="isn't one of an allowed signer"):
        reproduce(tmp_path / "claim.zip", tmp_path / "altered", signers=keys / "signers")
    assert not (tmp_path / "altered").exists()


def test_claim_of_another_signer_is_refused(tmp_path: Path, keys: Path) -> None:
    """A key that isn't in the file, no signature, and a key that isn't there."""
    played(tmp_path)
    claim = tmp_path / "claim.zip"
    pack([tmp_path / "run"], claim, sign=keys / "eve")
    with pytest.raises(RunError, match="isn't one of an allowed signer"):
        checked(tmp_path, signers=keys / "signers")
    Path(f"{claim}.sig").unlink()
    with pytest.raises(RunError, match="no signature"):
        checked(tmp_path, signers=keys / "signers")
    with pytest.raises(RunError, match="can't be signed"):
        pack([tmp_path / "run"], tmp_path / "other.zip", sign=keys / "nobody")


def test_source_that_changed_since_is_not_packed(tmp_path: Path) -> None:
    """Evidence and source of a claim belong together."""
    played(tmp_path)
    write_env(tmp_path, ("TURNS = 5", "TURNS = 4"))
    with pytest.raises(RunError, match="source of a run has changed"):
        pack([tmp_path / "run"], tmp_path / "claim.zip")
    assert not (tmp_path / "claim.zip").exists()


@pytest.mark.parametrize("name", ["../out.txt", "/out.txt", "a/../../out.txt", "a\\..\\out.txt"])
def test_names_that_lead_out_are_refused(tmp_path: Path, name: str) -> None:
    """Nothing is written outside the folder."""
    claim = tmp_path / "claim.zip"
    document = {"format": 1, "runs": [], "packages": {}, "files": {name: digest_of(b"x")}}
    with zipfile.ZipFile(claim, "w") as archive:
        archive.writestr(CLAIM, json.dumps(document))
        archive.writestr(name, b"x")
    with pytest.raises(RunError, match="no claim"):
        checked(tmp_path)
    assert not (tmp_path / "out.txt").exists()


@pytest.mark.parametrize("data", [b"", b"PK", b"{}"])
def test_other_files_are_no_claims(tmp_path: Path, data: bytes) -> None:
    """The error says what is expected."""
    (tmp_path / "claim.zip").write_bytes(data)
    with pytest.raises(RunError, match="no claim"):
        checked(tmp_path)
