"""Causes that can be held still, by the check whose failure shows them."""

from typing import Final

from gamekeeper.auditing.draw_holds import (
    entropy_held,
    generators_held,
    globals_held,
    ids_held,
    resets_held,
    spaces_held,
)
from gamekeeper.auditing.holds import (
    Hold,
    actions_held,
    agents_held,
    bounds_held,
    classes_held,
    contents_held,
    copies_held,
    dead_steps_held,
    ended_held,
    entries_held,
    flags_held,
    infos_held,
    instances_held,
    missing_held,
    names_held,
    observations_held,
    observe_held,
    orders_held,
    readings_held,
    rewards_held,
    rosters_held,
    state_held,
)

GLOBALS: Final = Hold(
    "global generators kept apart for each environment", globals_held, ("GK600",), is_general=True
)
ENTROPY: Final = Hold(
    "the system's entropy replaced by a constant", entropy_held, (), is_general=True
)
GENERATORS: Final = Hold(
    "own generators restarted, and what the constructor drew put back, at each reset",
    generators_held,
    (),
    is_general=True,
)
SPACES: Final = Hold("spaces seeded at each reset", spaces_held, (), is_general=True)
INSTANCES: Final = Hold(
    "a fresh instance for each reset",
    instances_held,
    ("GK103", "GK222", "GK406", "GK506", "GK523", "GK815"),
    is_general=True,
)
CLASSES: Final = Hold(
    "a copy of what the class keeps for each instance", classes_held, ("GK701", "GK702", "GK703")
)
READINGS: Final = Hold(
    "state() and render() called on a copy", readings_held, ("GK604", "GK607", "GK805", "GK814")
)
OBSERVATIONS: Final = Hold("observations copied", observations_held)
INFOS: Final = Hold("infos copied", infos_held)
DEAD_STEPS: Final = Hold("steps of the dead made by `_was_dead_step`", dead_steps_held)
MISSING: Final = Hold("missing entries added", missing_held)

OF_DRAWS: Final = (GLOBALS, ENTROPY)
"""Held where the same episode differs by itself, so that another fault in it can be shown."""
RESETS: Final = Hold("global generators seeded before each reset, as in the audit", resets_held)
AS_DRAWN: Final = ((RESETS,), (RESETS, ENTROPY))
"""Held where an episode shows a fault by what it drew: it draws the same again, as in the audit."""
HOLDS: Final = {
    "GK630": Hold("actions copied before they are handed to step", actions_held, is_general=True),
    "GK602": GLOBALS,
    "GK638": SPACES,
    "GK601": GENERATORS,
    "GK605": ENTROPY,
    "GK636": READINGS,
    "GK637": READINGS,
    "GK814": READINGS,
    "GK104": Hold("agents named once each", names_held),
    "GK102": Hold("possible_agents named anew", rosters_held, ("GK103", "GK523"), is_general=True),
    "GK103": Hold("all agents in `agents` before each reset", agents_held),
    "GK606": INSTANCES,
    "GK604": INSTANCES,
    "GK608": Hold("objects numbered in place of their id()", ids_held, (), is_general=True),
    "GK634": Hold("observe() called on a copy", observe_held, ("GK635",), is_general=True),
    "GK607": CLASSES,
    "GK701": Hold("copies made by playing the same calls again", copies_held),
    "GK610": OBSERVATIONS,
    "GK615": INFOS,
    "GK614": OBSERVATIONS,
    "GK611": INFOS,
    "GK612": Hold("results of state() copied", state_held),
    "GK405": Hold("`rewards` cleared before each step", rewards_held),
    "GK503": Hold("agents that have ended taken out of `agents`", ended_held),
    "GK505": Hold("flags of the ended kept up", flags_held),
    "GK303": DEAD_STEPS,
    "GK522": DEAD_STEPS,
    "GK107": MISSING,
    "GK109": MISSING,
    "GK106": Hold("entries of agents that aren't live deleted", entries_held),
    "GK214": Hold(
        "what is observed beyond a bound set to the bound", bounds_held, ("GK802", "GK813")
    ),
    "GK833": Hold("attributes emptied at each reset", contents_held, ("GK832",)),
    "GK311": Hold("actions in the order of possible_agents", orders_held),
}
"""By the check whose failure is a cause, in the order in which causes are established."""
