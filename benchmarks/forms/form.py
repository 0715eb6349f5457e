"""The true form of an environment as data, in the words of the contract.

Rules that settle each field:

- A *round* is every live agent's turn once; in a Parallel environment it is a tick.
- `None` says that the field has no sensible truth there and isn't judged; so does its name in
  `doubtful`, where a value stands that a second reader could argue against. `horizon` alone means
  something by `None`: no limit of time. `order_sensitive` is asked of Parallel environments only.
- `stages`: roles whose agents act in blocks stand apart; roles that act together, alternate or
  come in changing order stand in one.
- `order`: `none` where no move takes effect before all of the round are made.
- `observe`: `after turn` where an agent's move changes what a later agent of the same round
  observes or may do before it acts.
- `conflicts`: `joint rule` where the order of handling has no effect; `ordered` where turns take
  effect one by one; `priority` where moves are made together and handled in an order of names
  (`priority`: that of the `roster` or of the caller's `dictionary`); `random` where a draw settles.
- `legality`: an agent's move can change the action mask of another, in this round or later.
- `rewards`: parts by name. `lag`: rounds from the move that earns to the payment; 0 is the round of
  the move.
- `endings`: the kind, and the owner that ends; a limit of time is one of them.
- `may_leave`: out of `agents` without an ending.
- `symmetric`: by role, agents that could exchange names; None for a role of one agent.
- `influence`: (from role, to role, on, lag), agents' influence on others, each with the least lag.
  Rewards and endings: rounds from the move to the payment. Masks and observations: rounds from the
  move to the first decision of another agent that is made with them: 0 is a later agent's decision
  of the same round, 1 the next round's.
- `order_sensitive`: another order of the actions' dictionary changes nothing (`none`), `draws`, or
  the `outcome`.
- `advice`: `aec` where the order of a round decides state, legality or reward (`because`: which
  of them later agents of the round surely find otherwise; others may be named too); `parallel`
  where moves are made together; `either` where agents of a round have nothing to do with each
  other. Both APIs can hold a game of simultaneous moves: the natural one is named.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Part:
    """One part of the reward: the role that earns it, the role that is paid, and the lag."""

    earner: str
    payee: str
    kind: str
    lag: int | None = 0


@dataclass(frozen=True, slots=True)
class Ending:
    """One ending: `termination` or `truncation`, of one `agent` or of `all`."""

    kind: str
    owner: str


TIME = Ending("truncation", "all")
"""The ending that a limit of time is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """The true form of one environment; the fields are explained above."""

    name: str
    api: str
    stages: tuple[tuple[str, ...], ...]
    order: str | None
    observe: str | None
    conflicts: str | None
    priority: str | None = None
    legality: bool = False
    rewards: Mapping[str, Part] = field(default_factory=dict)
    endings: Mapping[str, Ending] = field(default_factory=dict)
    may_join: tuple[str, ...] = ()
    may_leave: tuple[str, ...] = ()
    symmetric: Mapping[str, bool | None]
    horizon: int | None
    deterministic: bool = True
    messages: tuple[str, ...] = ()
    influence: frozenset[tuple[str, str, str, int]]
    order_sensitive: str | None
    advice: str | None
    because: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()


def links(*rows: str) -> frozenset[tuple[str, str, str, int]]:
    """Influence from rows of text: `links("picker carrier mask 0")`."""
    parts = (row.split() for row in rows)
    return frozenset((source, to, on, int(lag)) for source, to, on, lag in parts)
