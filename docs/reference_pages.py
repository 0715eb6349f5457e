"""Writes the pages of commands, errors and interventions: `python -m docs.reference_pages`.

Their texts come from help texts and docstrings.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import typer

from gamekeeper import errors
from gamekeeper.cli._app import build_app
from gamekeeper.cli.list import intervention_card
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.rollouts.intervention import interventions

HERE: Final = Path(__file__).parent
EXAMPLE: Final = "Example: "
"""Start of a command's last paragraph; the rest is a line to type."""

_HEAD: Final = "<!-- written by `python -m docs.reference_pages` -->"

_COMMANDS: Final = f"""\
# Commands

{_HEAD}

`gamekeeper COMMAND --help` says the same in a terminal. Every command takes `--json` (one JSON
document on stdout, all else on stderr) and `--quiet`; `--seed`, `--workers` and `--policy` are
taken everywhere, and a note says where one has no effect.

| exit code | meaning |
|---|---|
| 0 | passed, verified, done; checks that were not exercised are counted on stderr |
| 1 | failed, diverged |
| 2 | no answer, or wrong use; the reason is on stderr |
| 130 | interrupted by Ctrl-C |
"""

_ERRORS: Final = f"""\
# Errors

{_HEAD}

Every error that Gamekeeper raises on purpose is a `gamekeeper.errors.GamekeeperError`, and also the
builtin that Python raises for such a mistake. It names the failure, the place, the expected and the
actual value, and a fix; these are attributes: `what`, `where`, `expected`, `actual`, `fix`.

| error | is also a | says |
|---|---|---|
"""
_TOP: Final = """\
# Interventions: what a rerun can do differently

<!-- written by `python -m docs.reference_pages` -->

An intervention is exactly one thing done differently in a rerun: nothing else is changed, and the
result is compared with the unchanged rerun. `gamekeeper list interventions` names all of them,
those of installed packages too.

## Perturbations

A perturbation makes one thing worse for the agents that it names, and has the failure label of that
thing. It shows what an agent *depends* on, never what made it fail: an agent that is blind
already ignores noise. All perturbations follow these rules.

- Strength 0 is the unchanged rerun, bit for bit. A higher strength uses the same random numbers
  and changes more, so that the smallest strength that flips an outcome can be searched.
- Every agent has its own stream of random numbers: other perturbed agents, the order of agents
  and their number have no effect on it.
- A changed observation is changed for the policy only. The run records the environment's
  observation and the action that was played; the action mask is a rule of the game and stays.
- Values keep their types and stay in their space. A value that isn't in its space, or isn't a
  number, is left alone.
- A substituted action that is illegal is replaced by the declared noop; where there is none, or
  it is illegal too, by the first legal action (of a Box: 0, or the value nearest to it).
- Where a perturbation can't be tried on an agent, `applies(contract, env, agent)` gives the
  reason, and a diagnosis lists it as *not tested*.

A strength is a probability at each of the agent's turns, a share, a standard deviation as a share
of a number's range, or a number of the agent's turns. *seen*: it changes observations, so that
policies must choose again; *done*: it changes actions, also recorded ones.
"""
_OTHERS: Final = """\
## Others

Interventions of audits and attribution; they have no strength.
"""
_OWN: Final = """\
## One of your own

A frozen dataclass; its hooks, made anew for each episode, change each turn. The entry point
`gamekeeper.interventions` of a package names the class, or a module with several.

```python
from dataclasses import dataclass
from typing import ClassVar

from gamekeeper.rollouts.interventions.sensors import ObservationPerturbation


@dataclass(frozen=True, slots=True)
class Mirrored(ObservationPerturbation):
    \"\"\"Shows an agent everything from the end to the beginning.

    The strength is the probability at each turn.
    \"\"\"

    label: ClassVar = "perception"
    USUAL: ClassVar = 1.0

    strength: float = USUAL

    def sensor(self, observed, rng):
        def see(observation):
            return observation[::-1].copy() if rng.random() < self.strength else observation

        return see
```
"""


def pages() -> dict[str, str]:
    """The pages by their files' names, from this folder."""
    return {
        "reference/commands.md": commands_page(),
        "reference/errors.md": _ERRORS + "".join(_error_rows(errors.GamekeeperError, 0)),
        "interventions.md": interventions_page(),
    }


def commands_page() -> str:
    """The page of all commands, in the order in which `--help` lists them."""
    group: Any = typer.main.get_command(build_app())
    return "\n".join([_COMMANDS, *(_section(name, each) for name, each in group.commands.items())])


def _section(name: str, command: Any) -> str:
    """The section of a command: its docstring, then its arguments and options."""
    context = command.context_class(command, info_name=name)
    shown = [each for each in command.params if not getattr(each, "hidden", False)]
    arguments = [each for each in shown if each.param_type_name == "argument"]
    words = " ".join(["gamekeeper", name, *map(_words, arguments)])
    lines = [f"## {name}", "", f"`{words}`"]
    for part in (command.help or "").split("\n\n"):
        paragraph = " ".join(part.split())
        is_example = paragraph.startswith(EXAMPLE)
        line = f"{EXAMPLE}`{paragraph.removeprefix(EXAMPLE)}`" if is_example else paragraph
        lines += ["", line]
    if (HERE / "pictures" / "commands" / f"{name}.svg").exists():
        lines += ["", f"![Output of gamekeeper {name}](../pictures/commands/{name}.svg)"]
    lines += ["", "| | |", "|---|---|"]
    for each in arguments:
        lines.append(f"| `{_code(_words(each))}` | {_cell(each.help or '')} |")
    for each in (each for each in shown if each.param_type_name == "option"):
        names = each.get_help_record(context)[0]  # as --help shows it
        is_typed = isinstance(each.default, str | int | float) and not isinstance(
            each.default, bool
        )
        default = f" Default: `{_code(str(each.default))}`." if is_typed else ""
        lines.append(f"| `{_code(names)}` | {_cell(each.help or '')}{default} |")
    return "\n".join(lines) + "\n"


def _words(argument: Any) -> str:
    words = (argument.metavar or argument.name.upper()) + "..." * (argument.nargs == -1)
    return words if argument.required else f"[{words}]"


def _error_rows(kind: type, depth: int) -> Iterator[str]:
    """The row of an error, then those of its subclasses."""
    plain = [base for base in kind.__mro__ if base.__module__ == "builtins"]
    shown = plain[: max(len(plain) - 3, 1)]  # Exception, BaseException and object say nothing
    builtins = ", ".join(f"`{base.__name__}`" for base in shown)
    about = _cell((inspect.getdoc(kind) or "").split("\n\n")[0])
    yield f"| {'&emsp;' * max(depth - 1, 0)}`gk.{kind.__name__}` | {builtins} | {about} |\n"
    known: list[type] = kind.__subclasses__()
    for other in known:
        if other.__module__ == errors.__name__:
            yield from _error_rows(other, depth + 1)


def interventions_page() -> str:
    """The page of our own interventions, perturbations by label in the order of the labels."""
    ours = [each for each in interventions().values() if each.__module__.startswith("gamekeeper.")]
    cards = [intervention_card(each) for each in ours]
    perturbations = [card for card in cards if card["kind"] == "perturbation"]
    lines = [_TOP, "| label | perturbations |", "|---|---|"]
    for label in LABELS:
        named = [
            f"[{x['name']}](#{x['name'].lower()})" for x in perturbations if x["label"] == label
        ]
        lines += [f"| {label} | {', '.join(named)} |"] if named else []
    for card in (x for label in LABELS for x in perturbations if x["label"] == label):
        strength = f"{card['unit']}; usually {card['usual']:g}, searched up to {card['most']:g}"
        facts = f"**{card['label']}**, {card['on']}; strength: {strength}."
        lines += ["", f"### {card['name']}", f"`{_call(card)}`", "", facts, "", card["about"]]
        lines += [line for part in card["says"] for line in ("", part)]
    lines += ["", _OTHERS, "| intervention | what it does |", "|---|---|"]
    others = [card for card in cards if card["kind"] != "perturbation"]
    lines += [f"| `{_call(card)}` | {card['about']} |" for card in others]
    return "\n".join([*lines, "", _OWN])


def _call(card: Mapping[str, Any]) -> str:
    """The call that makes it: `Held(turns=12)`."""
    given = card["parameters"].items()
    typed = [name if value is None else f"{name}={value}" for name, value in given]
    return f"{card['name']}({', '.join(typed)})"


def _cell(text: str) -> str:
    """Escapes a text for the cell of a table."""
    for mark in ("\\", "|", "<", "*", "_", "["):
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())


def _code(text: str) -> str:
    """Escapes the bars of code in the cell of a table, which backticks don't protect."""
    return text.replace("|", "\\|")


def main() -> None:
    """Writes the pages over the earlier ones."""
    for name, text in pages().items():
        (HERE / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
