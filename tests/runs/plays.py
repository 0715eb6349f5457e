"""How tests of recording write environments into files, play them and replay what was recorded."""

from pathlib import Path
from typing import Any

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import Replay, replay_evidence
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import rollout

WALKS = Path(__file__).with_name("walks.py")


def write_env(folder: Path, *edits: tuple[str, str], name: str = "walks.py") -> Path:
    """The file of environments, each edit made exactly once."""
    text = WALKS.read_text(encoding="utf-8")
    for old, new in edits:
        assert text.count(old) >= 1, old
        text = text.replace(old, new, 1)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def played(
    folder: Path, *edits: tuple[str, str], env: str = "Walk", out: str = "run", **options: Any
) -> Evidence:
    """A short rollout of an environment in a file of `folder`, recorded into `folder/out`."""
    options = {"episodes": 2, "seed": 0, **options}
    path = write_env(folder, *edits)
    return rollout(f"{path}:{env}", out=folder / out, **options)


def replayed(run: Path, *edits: tuple[str, str], env: str = "Walk", **options: Any) -> Replay:
    """A replay within this process, in the environment of `run.parent`, edited first."""
    path = write_env(run.parent, *edits)
    evidence = load(run)
    kwargs = evidence.manifest["environment"]["kwargs"]
    return replay_evidence(evidence, open_env(f"{path}:{env}", **kwargs), **options)


def step_through(env: Any, *, seed: int | None = None, turns: int = 99, action: Any = 1) -> None:
    """Resets a Parallel environment and steps it until it ends, or `turns` times."""
    env.reset(seed=seed)
    for _ in range(turns):
        if not env.agents:
            break
        env.step(dict.fromkeys(env.agents, action))
