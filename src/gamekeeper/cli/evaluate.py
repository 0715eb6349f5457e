"""`gamekeeper evaluate SPEC.toml`: policies side by side on the same seeds."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from gamekeeper.cli._fan import LOCAL, ExecutorOption
from gamekeeper.cli._options import (
    MOST,
    MOST_SEED,
    MOST_WORKERS,
    SILENCE_S,
    KwargsOption,
    TimeoutOption,
    json_object,
)
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import SpecError

if TYPE_CHECKING:
    from gamekeeper.evaluate.evaluation import Evaluation

ORDER: Final = 95
RUNS: Final = Path("runs")
REFUSED: Final = 2

SpecArgument = Annotated[
    str,
    typer.Argument(
        metavar="SPEC", show_default=False,
        help="A TOML file, a suite (gamekeeper list suites), or an environment with --policy.",
    ),
]  # fmt: skip
PolicyOption = Annotated[
    list[str] | None,
    typer.Option(
        "--policy", metavar="[NAME=]POLICY",
        help="Of an environment: who is compared. Repeatable; NAME is what results call it.",
    ),
]  # fmt: skip
EpisodesOption = Annotated[
    int | None,
    typer.Option(
        "--episodes", metavar="N", min=1, max=MOST, help="In place of the specification's."
    ),
]
SeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed", metavar="N", min=0, max=MOST_SEED, help="In place of the specification's."
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FOLDER",
        help="Raw episodes and results; otherwise runs/evaluation-NAME. A second call goes on "
        "there: what is there already isn't played again.",
    ),
]  # fmt: skip
CrossplayOption = Annotated[
    bool, typer.Option("--crossplay", help="Every policy in every seat with every partner.")
]
RecordOption = Annotated[
    Literal["digest", "full"] | None,
    typer.Option("--record", help="Keeps evidence of every line-up, to be replayed."),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        "--workers",
        metavar="N",
        min=1,
        max=MOST_WORKERS,
        help="Processes that play; otherwise a core each.",
    ),
]
StorageOption = Annotated[
    str | None,
    typer.Option(
        "--storage", metavar="PLACE",
        help="Where parts go: a folder or URL (s3://...) that all workers reach; else --out.",
    ),
]  # fmt: skip
ExportOption = Annotated[
    Path | None,
    typer.Option("--marl-eval", metavar="FILE", help="Also the raw scores in marl-eval's layout."),
]
PinOption = Annotated[
    bool, typer.Option("--pin", help="Only writes the digests of what is installed into SPEC.")
]
UnpinnedOption = Annotated[
    bool,
    typer.Option("--unpinned", help="Goes on where SPEC pins something else; results say so."),
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="Exit code 2 where an interval was refused.")
]


def command(
    screen: Screen,
    spec: SpecArgument,
    policy: PolicyOption = None,
    episodes: EpisodesOption = None,
    seed: SeedOption = None,
    crossplay: CrossplayOption = False,
    out: OutOption = None,
    kwargs: KwargsOption = None,
    record: RecordOption = None,
    workers: WorkersOption = None,
    executor: ExecutorOption = None,
    storage: StorageOption = None,
    marl_eval: ExportOption = None,
    pin: PinOption = False,
    unpinned: UnpinnedOption = False,
    strict: StrictOption = False,
    timeout: TimeoutOption = SILENCE_S,
) -> Answer:
    """Compares policies on the same seeds: per team, role and agent, with intervals and claims.

    The unit is the episode for a checkpoint, the training run for a method of several. Exit code
    0: done. 1: episodes broke off with an exception. 2: it can't be told, or wrong use; what isn't
    claimed, and why, stands at the end.
    """
    from gamekeeper.evaluate.evaluate import evaluate
    from gamekeeper.evaluate.given import spec_of
    from gamekeeper.report.evaluation_text import evaluation_text

    if pin:
        return _pinned(screen, spec, timeout)
    given = _policies(policy)
    env_kwargs = json_object(kwargs, option="--kwargs")
    changes: dict[str, Any] = {
        "policies": given, "episodes": episodes, "seed": seed, "crossplay": crossplay or None,
        "env_kwargs": env_kwargs, "record": record,
    }  # fmt: skip
    whole = spec_of(spec, **changes)
    folder = RUNS / f"evaluation-{_file_name(whole.name)}" if out is None else out
    try:
        with screen.progress("evaluating") as take:
            found = evaluate(
                spec, **changes, out=folder, storage=storage,
                workers=workers or (os.cpu_count() or 1), executor=executor or LOCAL,
                unpinned=unpinned, marl_eval=marl_eval, timeout_s=timeout, on_message=take,
                on_note=screen.note,
            )  # fmt: skip
    except KeyboardInterrupt:
        screen.error(f"parts that are whole stay in {storage or folder}: the same command goes on")
        raise
    document = found.to_json()
    screen.show(evaluation_text(document, width=screen.width))
    screen.show(f"\nRaw episodes  {storage or folder}/episodes.parquet")
    if marl_eval is not None:
        screen.note(f"raw scores written to {marl_eval}")
    return Answer(document, evaluation_code(found, strict=strict))


def evaluation_code(found: Evaluation, *, strict: bool) -> int:
    """1 where episodes broke off; with `strict`, 2 where an interval was refused."""
    if any((row["endings"] or {}).get("failed") for row in found.results):
        return 1
    return REFUSED if strict and found.refused else 0


def _policies(texts: list[str] | None) -> dict[str, str] | None:
    """Policies by name; the name is the policy's own where none is given."""
    found: dict[str, str] = {}
    for text in texts or ():
        name, equals, choice = text.partition("=")
        if not equals or re.search(r"[:/\\]", name):  # the = of a path or of an argument
            name, choice = re.sub(r"[/\\]", "_", text), text
        if name in found:
            raise SpecError(
                "two policies have one name", where="--policy", expected="different names",
                seen=name, mend=f"--policy NAME={choice}",
            )  # fmt: skip
        found[name] = choice
    return found or None


def _pinned(screen: Screen, text: str, timeout: float) -> Answer:
    """Writes digests into the file of a specification."""
    import tomllib

    import tomli_w

    from gamekeeper.evaluate.evaluate import looked_at
    from gamekeeper.evaluate.suites import fingerprint_of, pinned, suites

    path = Path(text) if text.endswith(".toml") else suites().get(text)
    if path is None:
        raise SpecError(
            "only a file can be pinned", where="SPEC", expected="a TOML file or a suite's name",
            seen=text,
        )  # fmt: skip
    spec, looks = looked_at(path, timeout_s=timeout)
    data = pinned(tomllib.loads(path.read_text(encoding="utf-8")), looks)
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(tomli_w.dumps(data), encoding="utf-8")
    draft.replace(path)
    fingerprint = fingerprint_of(spec, looks)
    screen.show(f"Pinned  {path}\n  fingerprint  {fingerprint}")
    digests = {name: look.digest for name, look in looks.items()}
    return Answer({"spec": str(path), "fingerprint": fingerprint, "environments": digests})


def _file_name(name: str) -> str:
    """A name that every file system takes."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-")[:60] or "evaluation"
