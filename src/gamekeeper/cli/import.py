"""`gamekeeper import FORM:DATA`: data sets of other libraries as runs."""

from pathlib import Path
from typing import Final

from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.export import found, source_of
from gamekeeper.errors import GamekeeperError

ORDER: Final = 121


def command(
    screen: Screen, data: str, out: Path, agent: str | None = None, joint: bool = False
) -> CommandResult:
    """Imports a data set of Minari as a run.

    What the data set doesn't tell is listed on stderr and in the JSON document. `gamekeeper list
    exporters` names the forms.

    Example: gamekeeper import minari:D4RL/door/human-v2 --agent hand --out runs/door

    Args:
        data (FORM:DATA): Data of another form: minari:ID, minari:FOLDER.
        out (--out FOLDER): Folder of the run; it must not exist yet (required).
        agent (--agent AGENT): Name that the data's only agent gets (default: agent_0).
        joint (--joint): Take each entry of the Dict spaces as an agent. Minari has one reward and
            no order for all: both are unknown then, and the reward stands in infos as joint_reward.
    """
    from gamekeeper.reporting.results_text import counted, digests_text, summary_text

    source = source_of(data, found().found)
    if source is None:
        raise GamekeeperError(
            "this names no form of data",
            where="FORM:DATA",
            expected="minari:ID or minari:FOLDER",
            actual=data,
            fix=f"minari:{data}",
        )
    read, name = source
    if joint and agent is not None:
        raise GamekeeperError(
            "--agent names the data's only agent, and with --joint there are several",
            where="--agent",
            actual=agent,
            fix="leave one of the two out",
        )
    given = {"agent": agent, "joint": joint or None}
    with screen.progress("importing"):
        evidence = read(name, out, **{key: x for key, x in given.items() if x is not None})
    imported = evidence.manifest["environment"].get("imported") or {}
    for each in imported.get("lacks", ()):
        screen.note(f"unknown: {each}")
    api = str(evidence.manifest["environment"].get("api"))
    screen.show(f"Imported  {counted(evidence.summary, api=api)}")
    screen.show(summary_text(evidence.summary, width=screen.width))
    screen.show(f"\nSaved in  {evidence.path}\n{digests_text(evidence)}")
    return CommandResult(
        {
            **evidence.to_json(),
            "path": str(evidence.path),
            "status": evidence.manifest.get("status"),
            "imported": dict(imported),
        }
    )
