"""The catalogue of public environments: environments.toml, read."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

HERE: Final = Path(__file__).parent
CATALOGUE: Final = HERE / "environments.toml"
GROUPS: Final = HERE / "groups.toml"
Group = Literal[
    "tuned",
    "related",
    "new",
    "left",
    "fresh",
    "second",
    "third",
    "fourth",
    "fifth",
    "sixth",
    "seventh",
    "eighth",
    "ninth",
    "tenth",
    "eleventh",
    "twelfth",
    "thirteenth",
    "fourteenth",
    "fifteenth",
]


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
    group: Group
    """*tuned*: checks were changed by it; *related*: by others of its package; *new*: neither;
    *left* and *fresh*: audited for the first time once checks were changed by all of these;
    *second* to *fifteenth*: likewise, once they were changed by those before."""

    @property
    def key(self) -> str:
        """Name of package and environment."""
        return f"{self.package}/{self.name}"


def catalogue(path: Path = CATALOGUE) -> Iterator[Listed]:
    """Every environment, in the file's order."""
    groups = tomllib.loads(GROUPS.read_text())
    for package in tomllib.loads(path.read_text())["packages"]:
        for each in package["environments"]:
            group: Group = "related" if package["name"] in groups["related"] else "new"
            key = f"{package['name']}/{each['name']}"
            apart = tuple(name for name in get_args(Group) if name not in ("related", "new"))
            group = next((name for name in apart if key in groups[name]), group)
            yield Listed(
                package=package["name"],
                version=package.get("version") or package["commit"],
                requirements=package["requirements"],
                python=package.get("python", "3.11"),
                name=each["name"],
                spec=re.sub(r"(\w+\.py):", rf"{HERE}/\1:", each["spec"]),
                kwargs=each.get("kwargs", {}),
                group=group,
            )
