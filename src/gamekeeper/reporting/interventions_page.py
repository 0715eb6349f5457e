"""Interventions as a page of the documentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.episodes.outcome import LABELS

Card = Mapping[str, Any]

_TOP: Final = """\
# Interventions: what a rerun can do differently

<!-- written by `python -m gamekeeper.cli._interventions docs/interventions.md` -->

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

from gamekeeper.rollouts.interventions.sights import ObservationPerturbation


@dataclass(frozen=True, slots=True)
class Mirrored(ObservationPerturbation):
    \"\"\"Shows an agent everything from the end to the beginning.

    The strength is the probability at each turn.
    \"\"\"

    label: ClassVar = "perception"
    USUAL: ClassVar = 1.0

    strength: float = USUAL

    def eye(self, sight, rng):
        def see(observation):
            return observation[::-1].copy() if rng.random() < self.strength else observation

        return see
```
"""


def interventions_page(cards: Sequence[Card]) -> str:
    """The page, perturbations by label in the order of the labels.

    Args:
        cards: for each intervention `name`, `about`, `says` (paragraphs), `label`, `kind`, `on`,
            `unit`, `usual`, `most` and `parameters` (by name the default as typed, or None).
    """
    perturbations = [card for card in cards if card["kind"] == "perturbation"]
    lines = [_TOP, "| label | perturbations |", "|---|---|"]
    for label in LABELS:
        named = [
            f"[{x['name']}](#{x['name'].lower()})" for x in perturbations if x["label"] == label
        ]
        lines += [f"| {label} | {', '.join(named)} |"] if named else []
    for label in LABELS:
        for card in (x for x in perturbations if x["label"] == label):
            lines += ["", *_section(card)]
    lines += ["", _OTHERS, "| intervention | what it does |", "|---|---|"]
    others = [card for card in cards if card["kind"] != "perturbation"]
    lines += [f"| `{_call(card)}` | {card['about']} |" for card in others]
    return "\n".join([*lines, "", _OWN])


def _section(card: Card) -> list[str]:
    strength = f"{card['unit']}; usually {card['usual']:g}, searched up to {card['most']:g}"
    facts = f"**{card['label']}**, {card['on']}; strength: {strength}."
    lines = [f"### {card['name']}", f"`{_call(card)}`", "", facts, "", card["about"]]
    return [*lines, *(line for part in card["says"] for line in ("", part))]


def _call(card: Card) -> str:
    """The call that makes it: `Held(turns=12)`."""
    given = card["parameters"].items()
    typed = [name if value is None else f"{name}={value}" for name, value in given]
    return f"{card['name']}({', '.join(typed)})"
