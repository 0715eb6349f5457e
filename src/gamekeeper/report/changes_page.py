"""Changes as a page: what a rerun can do differently."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.failure_label import LABELS

Card = Mapping[str, Any]

_TOP: Final = """\
# Changes: what a rerun can do differently

<!-- written by `python -m gamekeeper.cli._changes docs/changes.md` -->

A change is exactly one thing done differently in a play: nothing else of it is touched, and what
follows is compared with the same play without the change, the sham. `gamekeeper list changes`
names them all, those of installed packages too.

## Stressors

A stressor makes one thing worse for the agents that it names, and has the failure label of that
thing. It shows what an agent *depends* on, never what made it fail: an agent that is blind
already ignores noise. Whatever their label, all keep these rules.

- Strength 0 is the sham, bit for bit. More strength is the same draws with more of the same: a
  search for the smallest strength that flips an outcome walks along one line.
- Every agent's draws come from a stream of its own: who else is disturbed, the order of agents
  and their number change nothing.
- What is changed of an observation is changed for the policy alone. The evidence keeps what the
  environment gave and what was really done; the mask is a rule of the game and stays what it is.
- Values keep their types and stay in their space. What isn't of its space, or is no number, is
  left alone.
- An action in place of the chosen one that is illegal now gives way to the declared noop; where
  there is none, or it is illegal too, to the first legal action (of a Box: 0, or what is nearest
  to it).
- Where one can't be tried on an agent, `applies(contract, env, agent)` says why, and a diagnosis
  lists that as *not tested*.

A strength is a probability at each of the agent's turns, a part of the whole, a standard
deviation as a part of a number's range, or a number of the agent's turns. *seen*: only policies
feel it, so it needs the loop closed; *done*: also recorded actions do.
"""
_OTHERS: Final = """\
## Others

What audits and attribution do differently; they have no strength.
"""
_OWN: Final = """\
## One of your own

A frozen dataclass; what it does at each turn is in its hooks, made anew for each play. The entry
point `gamekeeper.changes` of a package names the class, or a module with some.

```python
from dataclasses import dataclass
from typing import ClassVar

from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.seeing import Seeing
from gamekeeper.run.stress.stressor import Stressor


@dataclass(frozen=True, slots=True)
class Mirrored(Stressor):
    \"\"\"Shows an agent everything from the end to the beginning.

    The strength is the probability at each turn.
    \"\"\"

    label: ClassVar = "perception"
    USUAL: ClassVar = 1.0
    ON: ClassVar = "seen"

    strength: float = USUAL

    def start(self, rng):
        return _Mirrored(self, rng) if self.strength else Hooks()


class _Mirrored(Seeing):
    def eye(self, sight, rng):
        def see(observation):
            return observation[::-1].copy() if rng.random() < self.strength else observation

        return see
```
"""


def changes_page(cards: Sequence[Card]) -> str:
    """The page, stressors by label in the order of the labels.

    Args:
        cards: of each change `name`, `about`, `says` (paragraphs), `label`, `kind`, `on`, `unit`,
            `usual`, `most` and `parameters` (by name the default as it is typed, or None).
    """
    stressors = [card for card in cards if card["kind"] == "stressor"]
    lines = [_TOP, "| label | stressors |", "|---|---|"]
    for label in LABELS:
        named = [f"[{x['name']}](#{x['name'].lower()})" for x in stressors if x["label"] == label]
        lines += [f"| {label} | {', '.join(named)} |"] if named else []
    for label in LABELS:
        for card in (x for x in stressors if x["label"] == label):
            lines += ["", *_section(card)]
    lines += ["", _OTHERS, "| change | what it does |", "|---|---|"]
    others = [card for card in cards if card["kind"] != "stressor"]
    lines += [f"| `{_call(card)}` | {card['about']} |" for card in others]
    return "\n".join([*lines, "", _OWN])


def _section(card: Card) -> list[str]:
    strength = f"{card['unit']}; usually {card['usual']:g}, searched up to {card['most']:g}"
    facts = f"**{card['label']}**, {card['on']}; strength: {strength}."
    lines = [f"### {card['name']}", f"`{_call(card)}`", "", facts, "", card["about"]]
    return [*lines, *(line for part in card["says"] for line in ("", part))]


def _call(card: Card) -> str:
    """How it is made: `Held(turns=12)`."""
    given = card["parameters"].items()
    typed = [name if value is None else f"{name}={value}" for name, value in given]
    return f"{card['name']}({', '.join(typed)})"
