"""The module of a new task: stand-in rules that pay every term and reach every ending."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from gamekeeper.report.scaffold.form import effort_code, noop_of, space_code
from gamekeeper.report.scaffold.plan import Plan
from gamekeeper.report.scaffold.stand_in import (
    FIRST_TERM,
    arrival,
    fault_turn,
    faults,
    furthest,
    is_ordered_anew,
    rules,
)

WIDTH: Final = 96
"""Columns of a docstring's rules, before the indent."""
FILLS: Final = {
    "box": ("Box", "np.array(steps[:count]) / FURTHEST"),
    "multidiscrete": ("MultiDiscrete", "np.minimum(steps[:count], space.nvec[:count] - 1)"),
    "multibinary": ("MultiBinary", "np.sign(steps[:count])"),
}
"""By kind of space its class, and how an observation is filled with the steps that are left."""


def environment_text(plan: Plan) -> str:
    """The whole module."""
    parts = [_head(plan), _policies(plan), _class_head(plan), _start(plan), _acting(plan)]
    parts += [_arrive(plan), _ends(plan), _seen(plan)]
    return "".join(parts)


def _head(plan: Plan) -> str:
    numbered = (f"R{number}. {rule}" for number, rule in enumerate(rules(plan), start=1))
    text = "\n".join(_wrapped(rule) for rule in numbered)
    forms = {form.kind for role in plan.roles for form in (role.observes, role.acts)}
    names = {"discrete": "Discrete", **{kind: name for kind, (name, _) in FILLS.items()}}
    spaces = ", ".join(sorted({names[kind] for kind in forms} | {"Box"}))
    fault_lines = ""
    if faults(plan):
        told = ", ".join(f'"{fault.name}"' for fault in faults(plan))
        comma = "," if len(faults(plan)) == 1 else ""
        fault_lines = f"FAULTS = ({told}{comma})\nFAULT_TURN = {fault_turn(plan)}\n"
    roles = ", ".join(f'"{role.name}": {role.count}' for role in plan.staged)
    return f'''"""{plan.class_name}: say here in one sentence what is to be done.

These rules stand in for yours: they pay every reward term and reach every ending that the contract
declares, so that all around them works already. Replace them one by one, each with its test in
tests/test_rules.py, and the contract with them.

{text}
"""

from __future__ import annotations

from typing import Any, ClassVar

import gamekeeper as gk
import numpy as np
from gymnasium.spaces import {spaces}

ROLES = {{{roles}}}
FURTHEST = {furthest(plan)}
{fault_lines}
'''


def _policies(plan: Plan) -> str:
    efforts = ", ".join(f'"{role.name}": {effort_code(role.acts)}' for role in plan.staged)
    noops = ", ".join(
        f'"{role.name}": {_noop_code(plan, role.name)}' for role in plan.staged
    )  # what stands in the contract, in the space's own types
    return f'''EFFORT = {{{efforts}}}
NOOP = {{{noops}}}


def role_of(agent: str) -> str:
    """The role of an agent: its name without its number."""
    return agent.rpartition("_")[0]


def reference(observation: Any, agent: str, info: Any, rng: Any) -> Any:
    """Goes on until it is there."""
    return EFFORT[role_of(agent)]


def lazy(observation: Any, agent: str, info: Any, rng: Any) -> Any:
    """Does nothing."""
    return NOOP[role_of(agent)]


'''


def _noop_code(plan: Plan, role: str) -> str:
    form = next(each.acts for each in plan.roles if each.name == role)
    if form.kind == "discrete":
        return str(noop_of(form))
    return effort_code(form).replace("np.ones", "np.zeros")


def _class_head(plan: Plan) -> str:
    base = "TurnEnv" if plan.api == "aec" else "TickEnv"
    seen = _entries(f'"{role.name}": {space_code(role.observes)}' for role in plan.staged)
    done = _entries(
        f'"{role.name}": {space_code(role.acts, is_action=True)}' for role in plan.staged
    )
    return f'''class {plan.class_name}(gk.{base}):
    """Say here what an agent sees and does; the contract says who is paid and ended for what."""

    metadata: ClassVar[dict[str, Any]] = {{
        "name": "{plan.name}_v0",
        "render_modes": ["ansi"],
        "is_parallelizable": {plan.api == "parallel"},
    }}
    contract = "{plan.name}.toml"
    policies: ClassVar[dict[str, Any]] = {{"reference": reference, "lazy": lazy}}

    def __init__(self, *, horizon: int | None = None, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode, horizon=horizon)
        self.possible_agents = [f"{{role}}_{{i}}" for role, n in ROLES.items() for i in range(n)]
        seen = {{
{seen}
        }}
        done = {{
{done}
        }}
        self.observation_spaces = {{agent: seen[role_of(agent)] for agent in self.possible_agents}}
        self.action_spaces = {{agent: done[role_of(agent)] for agent in self.possible_agents}}
        self.state_space = Box(0, FURTHEST, (len(self.possible_agents),), np.int64)
'''


def _start(plan: Plan) -> str:
    lines = "        agents = self.possible_agents\n"
    lines += "        self.to_go = {agent: rng.integers(1, FURTHEST + 1) for agent in agents}\n"
    if faults(plan):
        lines += """        self.acted = dict.fromkeys(agents, 0)
        self.fault = rng.choice((None, *FAULTS))
        self.struck = rng.choice(agents)
"""
    if is_ordered_anew(plan):
        lines += "        self.round = 0\n        self.due: list[str] = []\n"
    return f'''
    # -- state

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Makes the first state; everything that is random comes from `rng` (R1)."""
{lines}
    def state(self) -> np.ndarray:
        """Steps that each possible agent has to go, [agents] int64."""
        return np.array([self.to_go[agent] for agent in self.possible_agents], np.int64)
'''


def _acting(plan: Plan) -> str:
    counts = "        self.acted[agent] += 1\n" if faults(plan) else ""
    move = f'''
    def _go(self, agent: str, action: Any) -> None:
        """What an action does (R2)."""
{counts}        if self.to_go[agent] > 0 and np.any(np.asarray(action) != 0):
            self.to_go[agent] -= 1
            if self.to_go[agent] == 0:
                self._arrive(agent)
'''
    if plan.api == "parallel":
        return f'''
    # -- a tick

    def tick(self, actions: dict[str, Any]) -> None:
        """All agents at once; the actions come in the order of possible_agents (R3)."""
        for agent, action in actions.items():
            self._go(agent, action)
        self._look_for_ends()
{move}'''
    return f'''
    # -- a turn

    def act(self, agent: str, action: Any) -> None:
        """One turn of one agent."""
        self._go(agent, action)
        self._look_for_ends()
{_turns(plan)}{move}'''


def _turns(plan: Plan) -> str:
    """The methods that say whose turn it is; none where it is the roster's order."""
    if not is_ordered_anew(plan):
        return ""
    stages = str(plan.stages).replace("'", '"')
    sort = {
        "rotating": "            first = self.round % max(len(group), 1)\n"
        "            group = group[first:] + group[:first]\n",
        "random": "            self.rng.shuffle(group)\n",
        "state": "",
    }[plan.order]
    after_round = "            self.round += 1\n" if plan.order == "rotating" else ""
    if plan.order == "state":
        pick = """        first = ROLE_STAGE[role_of(self.due[0])]
        group = [each for each in self.due if ROLE_STAGE[role_of(each)] == first]
        chosen = max(group, key=self.to_go.__getitem__)
        self.due.remove(chosen)
        return chosen
"""
        numbers = {role: n for n, stage in enumerate(plan.stages) for role in stage}
        held = ", ".join(f'"{role}": {number}' for role, number in numbers.items())
        pick = pick.replace("ROLE_STAGE", f"{{{held}}}")
    else:
        pick = "        return self.due.pop(0)\n"
    return f'''
    def first_agent(self) -> str:
        """Who begins."""
        return self.next_agent("")

    def next_agent(self, agent: str) -> str:
        """Who acts next: each once in a round, group after group (R3)."""
        self.due = [each for each in self.due if each not in self.endings]
        if not self.due:
            self.due = self._new_round()
{after_round}{pick}
    def _new_round(self) -> list[str]:
        """Everybody who is left, in the order of a round."""
        order: list[str] = []
        for stage in {stages}:
            group = [each for each in self._left() if role_of(each) in stage]
{sort}            order += group
        return order
'''


def _arrive(plan: Plan) -> str:
    lines = []
    for number, term in enumerate(plan.terms, start=FIRST_TERM):
        indent = "        "
        if term.earner != "all":
            lines.append(f'{indent}if role_of(agent) == "{term.earner}":  # R{number}')
            indent += "    "
        else:
            lines.append(f"{indent}# R{number}")
        payees = "self._left()" if term.payee == "all" else f'self._left("{term.payee}")'
        if term.kind == "individual":
            lines.append(f'{indent}self.pay(agent, 1.0, term="{term.name}")')
        elif term.kind == "shared":
            lines.append(f"{indent}for each in {payees}:")
            lines.append(f'{indent}    self.pay(each, 1.0, term="{term.name}")')
        else:
            lines.append(f"{indent}for each in {payees}:")
            lines.append(f"{indent}    if each != agent:")
            lines.append(f'{indent}        self.pay(each, -1.0, term="{term.name}")')
            lines.append(f'{indent}        self.pay(agent, 1.0, term="{term.name}")')
    rules_text = "\n".join(lines)
    return f'''
    def _arrive(self, agent: str) -> None:
        """Who is paid when an agent arrives."""
{rules_text}

    def _left(self, role: str | None = None) -> list[str]:
        """The agents that haven't ended, or those of a role."""
        left = [agent for agent in self.agents if agent not in self.endings]
        return left if role is None else [agent for agent in left if role_of(agent) == role]
'''


def _ends(plan: Plan) -> str:
    number = FIRST_TERM + len(plan.terms)
    lines = []
    end = arrival(plan)
    if end is not None:
        if end.owner == "agent":
            lines += ["        for agent in self._left():"]
            lines += [f"            if self.to_go[agent] == 0:  # R{number}"]
            lines += [f'                self.terminate(agent, "{end.name}")']
        else:
            whom = "" if end.owner == "all" else f'"{end.owner}"'
            lines += [f"        group = self._left({whom})"]
            lines += [f"        if not any(self.to_go[agent] for agent in group):  # R{number}"]
            lines += ["            for agent in group:"]
            lines += [f'                self.terminate(agent, "{end.name}")']
        number += 1
    if faults(plan):
        lines += ["        is_struck = self.acted[self.struck] == FAULT_TURN"]
    for place, fault in enumerate(faults(plan), start=number):
        verb = "terminate" if fault.kind == "termination" else "truncate"
        group = {"all": "self._left()"}.get(fault.owner, f'self._left("{fault.owner}")')
        if fault.owner == "agent":
            group = "[agent for agent in self._left() if agent == self.struck]"
        lines += [f'        if is_struck and self.fault == "{fault.name}":  # R{place}']
        lines += [f"            for agent in {group}:"]
        lines += [f'                self.{verb}(agent, "{fault.name}")']
    text = "\n".join(lines)
    return f'''
    def _look_for_ends(self) -> None:
        """Who has ended now; the time limit is the base class's."""
{text}
'''


def _seen(plan: Plan) -> str:
    return f'''
    # -- what agents see

    def observe(self, agent: str) -> Any:
        """The steps that the agent itself has to go, then those of the others."""
        others = [each for each in self.possible_agents if each != agent]
        steps = [self.to_go[each] for each in (agent, *others)]
{_filling(plan)}
    def info(self, agent: str) -> dict[str, Any]:
        """The steps that the agent has to go."""
        return {{"to_go": self.to_go[agent]}}

    def render(self) -> str | None:
        """A line for each agent, a letter for each step to go."""
        if self.render_mode != "ansi":
            return None
        return "\\n".join(f"{{agent:>12}} {{'#' * steps}}" for agent, steps in self.to_go.items())
'''


def _filling(plan: Plan) -> str:
    """How an observation comes from `steps`, for each kind of space that a role has."""
    kinds = sorted({role.observes.kind for role in plan.roles})
    lines = ["        space = self.observation_space(agent)"]
    if "discrete" in kinds:
        lead = (
            "        if isinstance(space, Discrete):\n            "
            if len(kinds) > 1
            else "        "
        )
        lines.append(f"{lead}return np.int64(min(steps[0], int(space.n) - 1))")
    arrays = [kind for kind in kinds if kind != "discrete"]
    if not arrays:
        return "\n".join(lines) + "\n"
    lines.append("        seen = np.zeros(space.shape, space.dtype)")
    lines.append("        count = min(seen.size, len(steps))")
    for place, kind in enumerate(arrays):
        name, fill = FILLS[kind]
        word = "if" if place == 0 else "elif"
        indent = "        "
        if len(arrays) > 1:
            lines.append(f"{indent}{word} isinstance(space, {name}):")
            indent += "    "
        lines.append(f"{indent}seen.flat[:count] = {fill}")
    return "\n".join([*lines, "        return seen"]) + "\n"


def _entries(entries: Iterable[str]) -> str:
    return "\n".join(f"            {entry}," for entry in entries)


def _wrapped(rule: str) -> str:
    """A rule under its number, in lines that fit."""
    lines, line = [], "   "
    for word in rule.split(" "):
        if len(line) + 1 + len(word) > WIDTH:
            lines.append(line)
            line = "       "
        line += f" {word}"
    return "\n".join([*lines, line])
