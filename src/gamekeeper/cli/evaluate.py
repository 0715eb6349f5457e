"""`gamekeeper evaluate SPEC.toml`: policies side by side on the same seeds."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Final, Literal

from gamekeeper.cli._fan import LOCAL
from gamekeeper.cli._options import SILENCE_S, Count, Seed, Workers, json_object
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError, SpecError
from gamekeeper.import_guard import unguarded

if TYPE_CHECKING:
    from gamekeeper.evaluation.evaluation import Evaluation

ORDER: Final = 95
RUNS: Final = Path("runs")
REFUSED: Final = 2
MOST_PLAYERS: Final = 12
"""Most agents and roles that an error lists."""
NAMED: Final = ":="
"""Text between the name under which policies are shown and the policies."""


@unguarded()  # the user names what is run
def command(
    screen: Screen,
    spec: str,
    policy: list[str] | None = None,
    episodes: Count | None = None,
    seed: Seed | None = None,
    crossplay: bool = False,
    out: Path | None = None,
    kwargs: str | None = None,
    record: Literal["digest", "full"] | None = None,
    workers: Workers | None = None,
    executor: str | None = None,
    storage: str | None = None,
    marl_eval: Path | None = None,
    pin: bool = False,
    unpinned: bool = False,
    strict: bool = False,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Compares policies on the same seeds, with confidence intervals for team, role and agent.

    The statistical unit is the episode for one policy, and the training run for a method with
    several training runs. An interval that wouldn't hold the truth as often as it says is refused:
    the end of the output lists each with its reason and the next step. A second call with the same
    --out continues there.

    Exit code 0: done. 1: episodes ended with an exception. 2: wrong use, or with --strict an
    interval was refused.

    Example: gamekeeper evaluate warehouse --policy reference --policy random

    Args:
        spec (SPEC): Specification in TOML, a suite (gamekeeper list suites), or an environment
            together with --policy.
        policy (--policy [NAME:=][AGENT|ROLE=]POLICY): Policy to compare, shown in results as NAME;
            policies of one NAME play together. Repeatable (required where SPEC is an environment).
        episodes (--episodes N): Number of episodes that each policy plays; the interval of a mean
            asks for 95 (default: as in SPEC, or 100).
        seed (--seed N): Seed of the evaluation (default: as in SPEC, or 0).
        crossplay (--crossplay): Play every policy in every position with every partner.
        out (--out FOLDER): Folder of episodes and results; a second call continues there: it plays
            missing episodes, and again those whose policy, environment or contract changed, and is
            refused with another seed (default: runs/evaluation-NAME).
        record (--record): Record the episodes of each policy as a run, at this level (default: no
            runs).
        workers (--workers N): Number of worker processes (default: one per core).
        storage (--storage PLACE): Place of the episodes that workers play: a folder or URL
            (s3://...) that all of them reach (default: --out).
        marl_eval (--marl-eval FILE): Write the raw scores in marl-eval's layout (default: no such
            file).
        pin (--pin): Only write the digests of the installed environments and policies into SPEC.
        unpinned (--unpinned): Continue where SPEC pins other digests; the results say so.
        strict (--strict): Exit with 2 if a confidence interval was refused.
    """
    from gamekeeper.evaluation.evaluator import evaluate
    from gamekeeper.evaluation.suites import spec_of

    if pin:
        return _pinned(screen, spec, timeout)
    changes: dict[str, Any] = {
        "policies": _policies(
            policy, lambda: _players(spec, kwargs, timeout), spec=spec, kwargs=kwargs
        ),
        "episodes": episodes,
        "seed": seed,
        "crossplay": crossplay or None,
        "env_kwargs": json_object(kwargs, option="--kwargs"),
        "record": record,
    }
    whole = spec_of(spec, **changes)
    folder = RUNS / f"evaluation-{_file_name(whole.name)}" if out is None else out
    try:
        with screen.progress("evaluating") as take:
            found = evaluate(
                spec,
                **changes,
                out=folder,
                storage=storage,
                workers=workers or (os.cpu_count() or 1),
                executor=executor or LOCAL,
                unpinned=unpinned,
                marl_eval=marl_eval,
                timeout_s=timeout,
                on_message=take,
                on_note=screen.note,
            )
    except KeyboardInterrupt:
        screen.error(
            f"interrupted: the episodes played until now stay in {storage or folder}; the same "
            "command continues from them"
        )
        raise
    return _shown(screen, found, storage or folder, marl_eval=marl_eval, strict=strict)


def _shown(
    screen: Screen, found: Evaluation, place: object, *, marl_eval: Path | None, strict: bool
) -> CommandResult:
    """Shows the result, and the place of the raw episodes and of the raw scores."""
    from gamekeeper.reporting.evaluation_text import evaluation_text

    document = found.to_json()
    screen.show(evaluation_text(document, width=screen.width))
    screen.show(f"\nRaw episodes  {place}/episodes.parquet")
    if marl_eval is not None:
        screen.note(f"raw scores written to {marl_eval}")
    return CommandResult(document, evaluation_code(found, strict=strict))


def evaluation_code(found: Evaluation, *, strict: bool) -> int:
    """Returns 1 where episodes ended with an exception; 2 where `strict` and one was refused."""
    if any((row["endings"] or {}).get("failed") for row in found.results):
        return 1
    return REFUSED if strict and found.refused else 0


def _policies(
    texts: list[str] | None, players: Callable[[], Players], *, spec: str, kwargs: str | None
) -> dict[str, dict[str, str]] | None:
    """Reads the policies that are compared, by name; a bare policy's own name is its name.

    Args:
        players: returns the agents and roles of the environment; called only for an error.
    Raises:
        SpecError: a text could name a policy or an agent, or two of them have one name.
        PolicyError: a policy is incomplete, or two are for the same agents.
    """
    from gamekeeper.interface.policy import EVERYONE, parse_choices

    found: dict[str, list[str]] = {}
    for text in texts or ():
        name, is_named, choice = text.partition(NAMED)
        (place, policy), *_ = parse_choices([choice if is_named else text]).items()
        if not is_named and place != EVERYONE:
            raise _ambiguous(text, place, policy, players(), spec=spec, kwargs=kwargs)
        name = name.strip() if is_named else re.sub(r"[/\\]", "_", text)
        if name in found and not is_named:
            raise SpecError(
                "two policies have one name",
                where="--policy",
                expected="different names",
                actual=name,
                fix=f"--policy NAME{NAMED}{text}",
            )
        found.setdefault(name, []).append(choice if is_named else text)
    return {name: parse_choices(choices) for name, choices in found.items()} or None


Players = tuple[str, ...]
"""Names of the agents and the roles of an environment; empty where they aren't known."""


def _players(spec: str, kwargs: str | None, timeout: float) -> Players:
    """The agents and roles of the first environment; none where it can't be opened."""
    from gamekeeper.cli._form import look_at
    from gamekeeper.evaluation.inspection import opening_of
    from gamekeeper.evaluation.suites import spec_of

    settings: dict[str, Any] = {"env_kwargs": json_object(kwargs, option="--kwargs")}
    try:
        whole = spec_of(spec, policies={"random": "random"}, **settings)
        first = opening_of(next(iter(whole.environments.values())), whole)
        form = look_at(
            str(first["spec"]), env_kwargs=first["kwargs"], contract=None, silence_s=timeout
        )
    except GamekeeperError:  # the mistake in --policy is said all the same
        return ()
    roles = (each.role for each in form.agents if each.role is not None)
    return tuple(dict.fromkeys([*(each.name for each in form.agents), *roles]))


def _ambiguous(
    text: str, place: str, policy: str, players: Players, *, spec: str, kwargs: str | None
) -> SpecError:
    """Names both readings of `wolf=pol:chase`, with a line that works for each."""
    name = re.sub(r"\W+", "_", policy.rpartition(":")[2]) or "mine"
    command = f"gamekeeper evaluate {quote(spec)}"
    command += f" --kwargs {quote(kwargs)} --policy" if kwargs else " --policy"
    is_known = not players or place in players
    one = place if is_known else players[0]
    what, expected = f"{text!r} can be read in two ways", f"[NAME{NAMED}][AGENT|ROLE=]POLICY"
    if not is_known:
        what = f"{text!r} is for {place!r}, which is no agent and no role of {spec}"
        more = f" and {len(players) - MOST_PLAYERS} more" if len(players) > MOST_PLAYERS else ""
        expected = f"an agent or a role: {', '.join(players[:MOST_PLAYERS])}{more}"
    fix = (
        f"for all agents, shown as {place!r}: {command} {quote(f'{place}{NAMED}{policy}')}; "
        f"for {one} alone, with random actions for all others: "
        f"{command} {quote(f'{name}{NAMED}{one}={policy}')}"
    )
    return SpecError(what, where="--policy", expected=expected, actual=text, fix=fix)


def _pinned(screen: Screen, text: str, timeout: float) -> CommandResult:
    """Writes digests into the file of a specification."""
    import tomllib

    import tomli_w

    from gamekeeper.evaluation.evaluator import inspected
    from gamekeeper.evaluation.suites import fingerprint_of, pinned, suites

    path = Path(text) if text.endswith(".toml") else suites().get(text)
    if path is None:
        raise SpecError(
            "only a file can be pinned",
            where="SPEC",
            expected="a TOML file or a suite's name",
            actual=text,
            fix="write the specification into a TOML file, and name that",
        )
    spec, inspections = inspected(path, timeout_s=timeout)
    data = pinned(tomllib.loads(path.read_text(encoding="utf-8")), inspections)
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(tomli_w.dumps(data), encoding="utf-8")
    draft.replace(path)
    fingerprint = fingerprint_of(spec, inspections)
    screen.show(f"Pinned  {path}\n  fingerprint  {fingerprint}")
    digests = {name: inspection.digest for name, inspection in inspections.items()}
    return CommandResult({"spec": str(path), "fingerprint": fingerprint, "environments": digests})


def _file_name(name: str) -> str:
    """A name that every file system takes."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-")[:60] or "evaluation"
