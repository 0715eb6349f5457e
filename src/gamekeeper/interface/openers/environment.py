"""An environment object: `gk.rollout(env)`. There is only this one instance."""

from typing import Final

from gamekeeper.interface.env_source import Source, api_of
from gamekeeper.interface.object_source import LostError, facts_of

SYNTAX: Final = "an environment object"
ORDER: Final = 0


def matches(spec: object) -> bool:
    """Tells whether it is a PettingZoo environment already."""
    return api_of(spec) is not None


def locate(spec: object, api: str | None) -> Source:
    """A source that hands out the object itself, with facts on how it is built again."""
    try:
        facts = facts_of(spec)
    except LostError as lost:
        facts = {"lost": str(lost)}
    kind = type(getattr(spec, "unwrapped", spec))
    name = f"{kind.__module__}:{kind.__qualname__}"
    return Source(
        kind="object",
        factory=lambda: spec,
        spec=f"<object of {name}>",
        entry_point=name,
        is_single=True,
        facts=facts,
    )


def distrust(spec: object) -> str | None:
    """Always: a text can't name an object of another process."""
    return "it was recorded from an object in memory, which no text can build again"
