"""Snippets: the shortest way to see a finding again, as a Python program that raises meanwhile."""

import keyword
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

from gamekeeper.auditing.held_programs import pruned
from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.literal import literal, step_literal
from gamekeeper.checks.reproducer_source import text_of
from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.construction import is_in_folder
from gamekeeper.rollouts.episode_loop import EpisodePlan

WIDTH: Final = 96
"""A list of actions longer than this stands turn by turn."""
SHIPPED: Final = ("atari", "butterfly", "classic", "sisl")
"""Namespaces that PettingZoo itself registers; for others something must be imported first."""


@dataclass(frozen=True, slots=True)
class Home:
    """Lines by which a program gets the environment.

    Attributes:
        imports: lines at the top.
        make: an expression that builds an instance; empty where nothing can.
    """

    imports: tuple[str, ...]
    make: str

    def given(self, options: Mapping[str, Any]) -> str:
        """The expression with more keyword arguments, which stand last."""
        if not options or not self.make:
            return self.make
        start = self.make.removesuffix(")")
        more = [f"{name}={literal(value)}" for name, value in options.items()]
        if any(f"{name}=" in start for name in options):  # the user's own gives way
            more = [f"**{{**dict({start.partition('(')[2]}), **dict({', '.join(more)})}}"]
            start = f"{start.partition('(')[0]}("
        return f"{start}{'' if start.endswith('(') else ', '}{', '.join(more)})"


def home(spec: str, identity: Mapping[str, Any], kwargs: Mapping[str, Any]) -> Home:
    """Lines that build the environment, with PettingZoo alone where that is possible."""
    kind, entry = identity.get("kind"), str(identity.get("entry_point"))
    is_converted = spec.startswith(("aec:", "parallel:"))  # by us, not by its own factory
    module, _, factory = entry.partition(":")
    given = ", ".join(f"{name}={literal(value)}" for name, value in kwargs.items())
    if kind in ("object", "factory") or spec.startswith("<"):  # what it was built with is its own
        return Home((), "")
    if kind == "module" and not is_converted and factory.isidentifier():
        imported, folder = f"from {module} import {factory} as build", Path.cwd()
        if not is_in_folder(module.partition(".")[0], folder):
            return Home((imported,), f"build({given})")
        added = f"sys.path.append({str(folder)!r})"  # a program may lie in another folder
        return Home(("import sys", added, imported), f"build({given})")
    if kind == "file" and not is_converted and factory.isidentifier():
        path = PurePath(str(identity["path"]))
        if path.stem.isidentifier() and not keyword.iskeyword(path.stem):
            lines = ("import sys", f"sys.path.insert(0, {str(path.parent)!r})")
            return Home((*lines, f"from {path.stem} import {factory} as build"), f"build({given})")
    rest = f", {given}" if given else ""
    if kind == "id" and entry.partition("/")[0] in SHIPPED:
        api = str(identity["api"])
        return Home(("import pettingzoo",), f"pettingzoo.make({api!r}, {entry!r}{rest})")
    return Home(("import gamekeeper as gk",), f"gk.make({spec!r}, slim=False{rest})")


def agents_by_text(make: Callable[[], Any], seed: Any) -> Callable[[str], Any]:
    """Finds agents that an environment knows at first: values without a form of their own."""
    env = make()
    agents = getattr(env, "possible_agents", None)
    if agents is None:
        env.reset(seed=seed)
        agents = env.agents
    known = {repr(agent): agent for agent in agents}

    def agent_of(text: str) -> Any:
        if text not in known:  # which shows nothing of the environment
            raise NameError(f"no agent is {text}")
        return known[text]

    return agent_of


def snippet(
    where: Home, api: str, play: EpisodePlan, proof: Reproducer | None, *, title: str, shows: str
) -> str:
    """A program that plays `play` and raises as long as the fault is there.

    What its lines don't name is left out.

    Args:
        where: how to get the environment.
        api: `aec` or `parallel`.
        play: its actions are scripted.
        proof: the last lines; None: they only print.
        title: the check, in one line.
        shows: the expected and the actual value, for a comment.
    """
    proof = proof or Reproducer("# look at what stands in these: the finding says what is wrong")
    imports = [*where.imports, "import numpy as np", *(f"import {name}" for name in proof.imports)]
    made = where.given(proof.options) or "...  # your environment"
    actions, proven = _actions(play, api), _by_text(proof.lines, play)
    finder, _ = text_of(agents_by_text) if "agent_of(" in actions + proven else ("", ())
    lines = [
        f"# {title}",
        *(f"# {line}" for line in shows.splitlines()),
        *imports,
        "",
        "def make():",
        f"    return {made}",
        "",
        *(
            ("def plain():", f"    return {where.make or made}", "")
            if "plain()" in proof.lines
            else ()
        ),
        f"SEED = {play.seed!r}",
        *(("", finder, "agent_of = agents_by_text(make, SEED)") if finder else ()),
        f"ACTIONS = {actions}",
        "",
        *(_course(api, play) if proof.plays else ()),
        *proven.splitlines(),
    ]
    return pruned("\n".join(lines) + "\n")


def _by_text(lines: str, play: EpisodePlan) -> str:
    """The lines with agents called by their text, as a stranger's program finds them."""
    agents = dict.fromkeys(agent for each in play.actions or () for agent in each)
    for agent in agents:
        lines = lines.replace(repr(agent_name(agent)), repr(str(agent)))
    return lines


def _actions(play: EpisodePlan, api: str) -> str:
    texts = [step_literal(api, each) for each in play.actions or ()]
    line = "[" + ", ".join(texts) + "]"
    if len(line) <= WIDTH:
        return line
    if len(set(texts)) == 1:  # an environment may write into a dictionary or an array
        return f"[{texts[0]} for _ in range({len(texts)})]"
    return "[\n" + "".join(f"    {text},\n" for text in texts) + "]"


def _course(api: str, play: EpisodePlan) -> list[str]:
    options = "" if play.options is None else f", options={literal(play.options)}"
    reset = f"env.reset(seed=SEED{options})"
    if api == "parallel":
        return [
            "env = make()",
            f"observations, infos = {reset}",
            "for actions in ACTIONS:",
            "    observations, rewards, terminations, truncations, infos = env.step(actions)",
        ]
    return [
        "env = make()",
        reset,
        "for action in ACTIONS:",
        "    env.last()",
        "    env.step(action)",
    ]
