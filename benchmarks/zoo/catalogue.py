"""The catalogue of public environments: environments.toml, read."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, Literal

HERE: Final = Path(__file__).parent
CATALOGUE: Final = HERE / "environments.toml"


@dataclass(frozen=True, slots=True)
class Listed:
    """One environment of the catalogue, with the package that it comes from."""

    package: str
    version: str
    """A version of the index, or the commit of a public repository."""
    requirements: str
    """The list in requirements/zoo/ that its virtual environment is made from."""
    python: str
    name: str
    spec: str
    kwargs: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Name of package and environment."""
        return f"{self.package}/{self.name}"

    @property
    def half(self) -> Literal["tuned", "held"]:
        """Half of the catalogue: by a hash of the package, so that none of it is in both."""
        return "held" if sha256(self.package.encode()).digest()[0] % 2 else "tuned"

    @property
    def from_repository(self) -> bool:
        """Says that it's no package of the index."""
        return "/" in self.package


def catalogue(path: Path = CATALOGUE) -> Iterator[Listed]:
    """Every environment, in the file's order."""
    for package in tomllib.loads(path.read_text())["packages"]:
        for each in package["environments"]:
            yield Listed(
                package=package["name"],
                version=package.get("version") or package["commit"],
                requirements=package["requirements"],
                python=package.get("python", "3.11"),
                name=each["name"],
                spec=each["spec"].replace("factories.py:", f"{HERE / 'factories.py'}:"),
                kwargs=each.get("kwargs", {}),
            )
