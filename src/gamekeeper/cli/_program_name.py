"""Name by which a person started this command line, for commands that are shown to be typed."""

from __future__ import annotations

import pkgutil
import re
import shutil
import sys
from functools import cache
from pathlib import Path
from shlex import quote
from typing import Final

NAME: Final = "gamekeeper"


def typed_name() -> str:
    """`gamekeeper`; its path, or `python -m gamekeeper`, where that is how it was started.

    A path is given only where the shell wouldn't find this very command by its name.
    """
    typed = Path(sys.argv[0])
    if typed.name == "__main__.py" and typed.parent.name == NAME:
        return f"{quote(sys.orig_argv[0])} -m {NAME}"
    if typed.name != NAME or not typed.is_file():
        return NAME
    found = shutil.which(NAME)
    is_found = found is not None and Path(found).samefile(typed)
    return NAME if is_found else quote(str(sys.argv[0]))


def as_typed(text: str) -> str:
    """The text, with each command in it named as the person named it."""
    if f"{NAME} " not in text:
        return text
    name = typed_name()
    return text if name == NAME else _commands().sub(lambda _: name, text)


@cache
def _commands() -> re.Pattern[str]:
    """The name in front of one of its commands, and not as part of a path or another name."""
    found = pkgutil.iter_modules([str(Path(__file__).parent)])
    names = "|".join(each.name.replace("_", "-") for each in found if each.name[0] != "_")
    return re.compile(rf"(?<![\w./-]){NAME}(?= (?:{names})\b)")
