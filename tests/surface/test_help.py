"""Help texts of all commands and options: unit, default and an example, in the field's words."""

import re
from typing import Any, Final

import pytest
import typer

from gamekeeper.cli._app import build_app

COMMANDS: Final[dict[str, Any]] = dict(typer.main.get_command(build_app()).commands)  # type: ignore[attr-defined]
SHOWN: Final = [
    (name, parameter)
    for name, command in COMMANDS.items()
    for parameter in command.params
    if not getattr(parameter, "hidden", False) and parameter.name != "help"
]
IDS: Final = [f"{name} {parameter.opts[0]}" for name, parameter in SHOWN]
BAD_START: Final = re.compile(
    r"(who|whom|whose|what|whether|which|how|where|why|of|nobody|nothing|otherwise|also|its|those)\b",
    re.IGNORECASE,
)
DIALECT: Final = re.compile(
    r"\b(otherwise as|goes on|what nobody|nobody|side by side|seat|cast|who plays|told|kept in|"
    r"broken|can't be told|it can't tell|what is there)\b",
    re.IGNORECASE,
)
UNITS: Final = {"S": "seconds", "MB": "MB"}
"""Unit that a help text names, by the metavar of its option."""
UNIT_OF_NAME: Final = {
    "timeout": "seconds",
    "memory": "MB",
    "budget": r"\b(steps|episodes|MB)\b",
    "frames_budget": "MB",
    "fps": "frames per second",
    "horizon": "ticks",
    "most_turns": "turns",
}
"""Unit that a help text names, by the option's name."""


def text_of(parameter: Any) -> str:
    """The help of an argument or an option, on one line."""
    return " ".join((parameter.help or "").split())


def takes_value(parameter: Any) -> bool:
    """Tells if an option is followed by a value."""
    return parameter.param_type_name == "option" and not getattr(parameter, "is_flag", False)


@pytest.mark.parametrize(("command", "parameter"), SHOWN, ids=IDS)
def test_help_is_a_sentence_of_the_field(command: str, parameter: Any) -> None:
    """A help text begins with a capital or a name, ends with a stop, and has no private words."""
    text = text_of(parameter)
    assert text[:1].isupper(), text
    assert text.endswith("."), text
    assert BAD_START.match(text) is None, text
    assert DIALECT.search(text) is None, text


@pytest.mark.parametrize(("command", "parameter"), SHOWN, ids=IDS)
def test_option_with_a_value_has_its_default(command: str, parameter: Any) -> None:
    """An option that takes a value shows its default, or is required."""
    if takes_value(parameter):
        is_shown = parameter.default not in (None, "") and parameter.show_default
        text = text_of(parameter)
        assert is_shown or "(default: " in text or "(required" in text or "required)" in text, text


@pytest.mark.parametrize(("command", "parameter"), SHOWN, ids=IDS)
def test_option_of_time_or_size_has_its_unit(command: str, parameter: Any) -> None:
    """An option of time, size or length names its unit."""
    if takes_value(parameter):
        for unit in (UNITS.get(parameter.metavar), UNIT_OF_NAME.get(parameter.name)):
            assert unit is None or re.search(unit, text_of(parameter)), text_of(parameter)


@pytest.mark.parametrize("name", COMMANDS)
def test_command_has_a_verb_and_an_example(name: str) -> None:
    """A command's help begins with a verb in the present tense, and ends with an example."""
    first, *_, last = [" ".join(part.split()) for part in COMMANDS[name].help.split("\n\n")]
    assert re.match(r"[A-Z][a-z]+s\b.*\.$", first), first
    assert last.startswith(f"Example: gamekeeper {name} "), last
    assert DIALECT.search(COMMANDS[name].help) is None


def test_help_names_no_type_of_python() -> None:
    """An argument is its name: `RUN`, and neither `RUN <list[Path]>` nor `{RUN}`."""
    for name, command in COMMANDS.items():
        out = command.make_context(name, [], resilient_parsing=True).get_help()
        assert re.search(r"<(str|int|path|list\[)", out) is None, out
        assert "{" not in out.partition("\n")[0], out


@pytest.mark.parametrize("name", COMMANDS)
def test_example_has_options_of_its_command(name: str) -> None:
    """Every option in an example is one of its command's."""
    example = COMMANDS[name].help.rpartition("Example: ")[2]
    known = {option for parameter in COMMANDS[name].params for option in parameter.opts}
    assert set(re.findall(r"(?<!\S)--[a-z-]+", example)) <= known
