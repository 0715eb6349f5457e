"""Digests: what makes an environment and a policy other ones."""

from pathlib import Path

from gamekeeper.evaluation.inspection import digest_of, environment_digest, placed, policy_digest
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.policy import resolve

POLICY = "def act(observation, agent, info, rng):\n    return {0}\n"


def test_digest_of_an_environment_is_of_its_arguments_and_options() -> None:
    """The same however often it is opened."""
    first, again = (open_env("two_robot_line", n=5).identity for _ in range(2))
    other = open_env("two_robot_line", n=7).identity
    assert environment_digest(first) == environment_digest(again)
    assert environment_digest(first) != environment_digest(other)
    assert environment_digest(first) != environment_digest(first, {"layout": 1})
    assert environment_digest(first) == environment_digest({**first, "versions": {}})


def test_digest_of_a_policy_is_of_its_file_wherever_it_lies(tmp_path: Path) -> None:
    """Moved, it is the same; edited, another."""
    found = []
    for folder, action in (("a", 1), ("b", 1), ("c", 2)):
        path = tmp_path / folder / "p.py"
        path.parent.mkdir()
        path.write_text(POLICY.format(action))
        found.append(policy_digest({"*": resolve(f"{path}:act")}))
    assert found[0] == found[1]
    assert found[0] != found[2]


def test_digest_of_a_policy_is_of_files_it_names(tmp_path: Path) -> None:
    """Weights beside the code."""
    weights = tmp_path / "w.npz"
    weights.write_bytes(b"one")
    random = {"*": resolve("random")}
    one = policy_digest(random, [str(weights)])
    weights.write_bytes(b"two")
    assert one != policy_digest(random, [str(weights)])
    assert policy_digest(random) != policy_digest({"picker": resolve("random")})


def test_digest_of_data_knows_no_order_of_keys() -> None:
    """As JSON with sorted keys."""
    assert digest_of({"a": 1, "b": [2]}) == digest_of({"b": [2], "a": 1})


def test_paths_are_looked_for_beside_the_specification(tmp_path: Path) -> None:
    """Before `:name`, behind a word, and alone; whatever isn't there stays as it is."""
    for name in ("p.py", "m.zip", "c.toml"):
        (tmp_path / name).write_text("")
    folder = str(tmp_path)
    assert f"{tmp_path}/p.py:act" == placed("p.py:act", folder)
    assert f"sb3:{tmp_path}/m.zip" == placed("sb3:m.zip", folder)
    assert f"{tmp_path}/c.toml" == placed("c.toml", folder)
    assert placed("mpe2.simple_spread_v3:env", folder) == "mpe2.simple_spread_v3:env"
    assert placed("random", folder) == "random"
    assert placed(7, folder) == 7
