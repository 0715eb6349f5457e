"""Wrappers of an environment, and the one of them that brings a fault in."""

from collections.abc import Callable, Sequence

from gamekeeper.auditing.held_programs import after_make


def within(program: str, depth: int) -> str:
    """The program with so many of the outermost wrappers left out."""
    head, tail = after_make(program)
    inner = f"\ndef within():\n    return whole(){'.env' * depth}\n\nwhole, make = make, within\n"
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
        if not passes(within(program, len(wrappers))):
            continue
        for depth in reversed(range(len(wrappers))):
            if not passes(within(program, depth)):
                return wrappers[depth]
    return None
