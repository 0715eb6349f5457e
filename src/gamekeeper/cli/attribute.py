"""`gamekeeper attribute RUN`: contribution of each agent, and influence of agents on others."""

from pathlib import Path
from typing import Final, Literal

from gamekeeper.cli import _options
from gamekeeper.cli._annotated import annotated
from gamekeeper.cli._fan import players_of
from gamekeeper.cli._options import Number
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.diagnose import beside

ORDER: Final = 93
ACTION_EPISODES: Final = 50
"""As `contributions.ACTION_EPISODES` has it; importing that loads numpy, help doesn't."""


def command(
    screen: Screen,
    run: Path,
    baseline: Literal["noop", "random", "reference"] = "noop",
    episodes: Number | None = None,
    action_episodes: Number = ACTION_EPISODES,
    budget: int | None = None,
    contract: Path | None = None,
    policy: list[str] | None = None,
    env: str | None = None,
    seed: int = 0,
    workers: int | None = None,
    executor: str | None = None,
    out: Path | None = None,
    allow_import: bool = False,
    timeout: float = _options.SILENCE_S,
) -> CommandResult:
    """Measures each agent's contribution: difference rewards, Shapley values, influence.

    Plays new episodes in which a baseline policy replaces agents and the others react, and
    episodes in which the actions of one agent are replaced and the others repeat theirs. Shows
    the return of each agent, what the team loses without it, lazy agents, the effect of actions
    and messages on other agents, and penalties that another agent caused.

    Example: gamekeeper attribute runs/warehouse-1 --policy reference

    Args:
        baseline (--baseline): Policy that takes an agent's place; noop becomes random where the
            contract declares no noop.
        episodes (--episodes N): New episodes with agents replaced (default: 50; with fewer, no
            confidence intervals).
        action_episodes (--action-episodes N): Episodes that are played again with actions of one
            agent replaced, while the others repeat theirs: recorded ones first, then new ones.
        out (--out FOLDER): Folder of what was played; a second call continues there (default:
            RUN-attribution).
    """
    from gamekeeper.diagnosis.attribution.contributions import attribute
    from gamekeeper.interface.policy import parse_choices
    from gamekeeper.reporting.attribution_text import attribution_text

    with (
        players_of(executor, workers or 1, asked=workers) as players,
        screen.progress("attributing") as take,
    ):
        found = attribute(
            run,
            contract=contract,
            baseline=baseline,
            episodes=episodes,
            action_episodes=action_episodes,
            budget=budget,
            policies=parse_choices(policy) if policy else None,
            env=env,
            seed=seed,
            workers=players,
            out=out or beside(run, "attribution"),
            allow_import=allow_import,
            timeout_s=timeout,
            on_message=take,
        )
    document = found.to_json()
    if found.reused:
        screen.note(
            f"{found.reused:,} of the new episodes were there already, from an earlier call"
        )
    screen.show(attribution_text(document, width=screen.width))
    annotated(screen, run, "attribution", document)
    return CommandResult(document, 0)
