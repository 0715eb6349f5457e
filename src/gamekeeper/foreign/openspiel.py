"""`openspiel:tic_tac_toe`: a game of OpenSpiel's through Shimmy, one agent a turn."""

from typing import Any, Final

from gamekeeper.errors import SpecError
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.env_source import Source

WORD: Final = "openspiel"
SYNTAX: Final = "openspiel:tic_tac_toe"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = foreign_openers.distrust_packages("pyspiel", "shimmy")


def locate(spec: str, api: str | None) -> Source:
    """The game under its short name; keyword arguments are the game's own parameters."""
    name = foreign_openers.rest(spec, WORD) or ""
    spiel = foreign_openers.need("pyspiel")
    shimmy = foreign_openers.need("shimmy.openspiel_compatibility")
    if name not in spiel.registered_names():
        raise foreign_openers.unknown(name, "OpenSpiel", list(spiel.registered_names()))

    def build(**kwargs: Any) -> object:
        _refuse(spiel, name, kwargs)
        env = shimmy.OpenSpielCompatibilityV0(game_name=name, config=kwargs or None)
        env.metadata = {**env.metadata, "name": name}
        return env

    return foreign_openers.source(
        WORD,
        name,
        build,
        default_api="aec",
        pip="shimmy open-spiel",
        facts=foreign_openers.package_fact("pyspiel"),
    )


def _refuse(spiel: Any, name: str, parameters: dict[str, Any]) -> None:
    """Games that can't be played by agents alone."""
    kind = spiel.load_game(name, parameters).get_type() if parameters else None
    kind = kind or spiel.load_game(name).get_type()
    if kind.dynamics == spiel.GameType.Dynamics.MEAN_FIELD:
        raise SpecError(
            f"{name} is a mean-field game",
            where=name,
            expected="a game whose moves are its players' and chance's",
            actual="moves of a distribution over a population",
            fix="play it with OpenSpiel's own mean-field algorithms",
        )
