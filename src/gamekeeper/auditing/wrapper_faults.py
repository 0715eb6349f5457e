"""Wrappers of an environment, and the one of them that brings a fault in."""

from collections.abc import Callable, Sequence

from gamekeeper.auditing.held_programs import after_make
from gamekeeper.interface.wrapper_names import CONVERTER


def within(program: str, wrappers: Sequence[str], depth: int) -> str:
    """The program with so many of the outermost wrappers left out.

    Where PettingZoo's converter is one of them, this package's converts in its place.
    """
    head, tail = after_make(program)
    env = f"whole(){'.env' * depth}"
    if CONVERTER in wrappers[:depth]:
        env = f"to_aec({env})"
        head = f"from gamekeeper.interface.conversion import to_aec\n{head}"
    inner = f"\ndef within():\n    return {env}\n\nwhole, make = make, within\n"
    return f"{head}{inner}{tail}"


def faulty_wrapper(
    programs: Sequence[str], wrappers: Sequence[str], passes: Callable[[str], bool]
) -> str | None:
    """The wrapper with which a program fails, and without which it passes.

    Args:
        programs: of one finding; where the rules raise in the first, as its actions were made up,
            the next is asked.
        wrappers: names, the outermost first.
        passes: tells whether a program passes.
    Returns:
        Its name; None where no program passes with the rules alone, or there is no wrapper.
    """
    for program in programs if wrappers else ():
        if not passes(within(program, wrappers, len(wrappers))):
            continue
        for depth in reversed(range(len(wrappers))):
            if not passes(within(program, wrappers, depth)):
                return wrappers[depth]
    return None
