"""Specifications, read from TOML and plain data."""

from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.evaluation.spec import Spec
from gamekeeper.evaluation.spec_reader import read_file, read_spec

LINE = {"line": {"spec": "two_robot_line"}}
BOTH = {"a": "random", "b": "noop"}


def spec(**sections: Any) -> Spec:
    """A small specification with more sections."""
    return read_spec({"environments": LINE, "policies": BOTH, **sections}, source="s.toml")


def test_spec_takes_policies_in_every_form() -> None:
    """A text, a table by role, a list of runs, and tables that say more."""
    found = spec(
        policies={
            "one": "random",
            "by_role": {"picker": "random", "carrier": "noop"},
            "runs": ["random", {"picker": "noop", "carrier": "random"}],
            "told": {"policy": "random", "version": "2", "files": ["w.npz"]},
            "there": {"environments": {"line": {"runs": ["random", "noop"]}}},
        }
    ).policies
    assert found["one"].runs[0] == {"*": "random"}
    assert found["by_role"].runs[0] == {"picker": "random", "carrier": "noop"}
    assert [found[n].is_method for n in ("one", "by_role", "runs")] == [False, False, True]
    assert found["told"].files == ("w.npz",)
    assert found["there"].is_method
    assert len(found["there"].runs_in("line")) == 2
    assert found["there"].runs_in("elsewhere") == ()


def test_spec_compares_all_pairs_unless_told() -> None:
    """Each pair once; or those that are named."""
    assert spec().pairs == (("a", "b"),)
    assert spec(compare={"pairs": [["b", "a"]]}).pairs == (("b", "a"),)
    assert spec(compare="all").pairs == (("a", "b"),)


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"polices": {}}, "write 'policies'"),
        ({"seeds": {"episode": 5}}, "write 'episodes'"),
        ({"environments": {"line": {"spec": "x", "kwarg": {}}}}, "write 'kwargs'"),
        ({"environments": {}}, "there are no environments"),
        ({"policies": {"a": {"runs": ["x", "x"]}}}, "stands twice"),
        (
            {"policies": {"a": {"policy": "x", "runs": ["y"]}}},
            "one policy or several training runs",
        ),
        ({"policies": {"a/b": "x"}}, "can't be a name"),
        ({"compare": {"pairs": [["a", "c"]]}}, "there is no policy 'c'"),
        ({"compare": {"pairs": [["a", "a"]]}}, "two different policies"),
        ({"crossplay": {"partners": ["B"]}}, "write 'b'"),
        ({"stop": {"metric": "return"}}, "nothing says when to stop"),
        ({"stop": {"width": 0.1, "most": 5}}, "beyond the first episodes"),
        ({"stop": {"width": True}}, "a number between"),
        ({"environments": {"line": {"spec": "x", "success": "return <"}}}, "can't be read"),
        ({"record": "ful"}, "write 'full'"),
        ({"seeds": {"episodes": 0}}, "a whole number from 1 on"),
        ({"metrics": {"level": 2}}, "a number between"),
    ],
)
def test_spec_refuses_what_it_cannot_mean(sections: dict[str, Any], said: str) -> None:
    """With the place, and the word that was probably meant."""
    with pytest.raises(SpecError) as refusal:
        spec(**sections)
    assert said in str(refusal.value)
    assert "s.toml" in str(refusal.value)


def test_spec_refuses_agents_as_a_sample() -> None:
    """The reason is said, since it is asked for."""
    with pytest.raises(EvidenceError, match="agents of one episode"):
        spec(metrics={"unit": "agent"})


def test_spec_of_a_file_names_it_in_errors(tmp_path: Path) -> None:
    """Text that isn't TOML, a file that isn't there, a key that is unknown."""
    path = tmp_path / "e.toml"
    with pytest.raises(SpecError, match="can't be opened"):
        read_file(path)
    path.write_text("a = ")
    with pytest.raises(SpecError, match="isn't TOML"):
        read_file(path)
    path.write_text("[enviroments.x]\nspec = 'x'\n")
    with pytest.raises(SpecError, match=r"e\.toml, line 1, enviroments"):
        read_file(path)


def test_spec_as_plain_data_leaves_defaults_out() -> None:
    """So that a new key with a default changes no fingerprint."""
    plain = spec().to_json()
    assert plain["environments"]["line"] == {"spec": "two_robot_line"}
    assert plain["policies"]["a"] == {"runs": [{"*": "random"}]}
    assert "stop" not in plain
    assert "folder" not in plain
