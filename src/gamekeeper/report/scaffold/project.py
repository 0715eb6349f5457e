"""All files of a new task's package, by their paths."""

from __future__ import annotations

from typing import Final

from gamekeeper.report.scaffold.environment import environment_text
from gamekeeper.report.scaffold.form import contract_of
from gamekeeper.report.scaffold.plan import Plan
from gamekeeper.report.scaffold.stand_in import rules
from gamekeeper.report.scaffold.tests_text import promises_text, rules_text

PYTHONS: Final = ("3.11", "3.12", "3.13")
"""Versions of Python that the package's CI runs its tests on."""


def spec_of(plan: Plan) -> str:
    """How the environment is named on the command line, in the package's folder."""
    return f"src/{plan.name}/env.py:{plan.class_name}"


def audit_line(plan: Plan) -> str:
    """The command that audits the environment in seconds, for every push."""
    return f"gamekeeper audit {spec_of(plan)} --quick"


def files_of(plan: Plan) -> dict[str, str]:
    """Text by path, in the order in which a person reads them.

    Raises:
        ContractError: two answers contradict each other.
    """
    name = plan.name
    return {
        "README.md": _readme(plan),
        f"src/{name}/env.py": environment_text(plan),
        f"src/{name}/{name}.toml": contract_of(plan).to_toml(),
        f"src/{name}/__init__.py": _front(plan),
        "tests/test_rules.py": rules_text(plan),
        "tests/test_promises.py": promises_text(plan),
        "pyproject.toml": _pyproject(plan),
        ".github/workflows/tests.yml": _workflow(plan),
        ".gitignore": "__pycache__/\n.pytest_cache/\n.venv/\n*.egg-info/\nbuild/\ndist/\nruns/\n",
    }


def _front(plan: Plan) -> str:
    return f'''"""{plan.class_name}: importing this package registers it as `{plan.name}-v0`."""

import pettingzoo

pettingzoo.register("{plan.api}", "{plan.name}-v0", "{plan.name}.env:{plan.class_name}")
'''


def _pyproject(plan: Plan) -> str:
    return f'''[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "{plan.name}"
version = "0.1.0"
description = "A multi-agent environment."
readme = "README.md"
requires-python = ">=3.11"
dependencies = ["gamekeeper", "gymnasium", "numpy", "pettingzoo>=1.27"]

[project.optional-dependencies]
test = ["pytest>=8"]

[project.entry-points."gamekeeper.envs"]
{plan.name} = "{plan.name}"   # once installed: gamekeeper run {plan.name}

[tool.hatch.build.targets.wheel]
packages = ["src/{plan.name}"]

[tool.pytest.ini_options]
testpaths = ["tests"]
pythonpath = ["src"]
filterwarnings = [
    "ignore:The old environment creation API:DeprecationWarning",   # PettingZoo's own modules
    "ignore::UserWarning:pettingzoo.test",   # its tests have a taste in spaces
]
'''


def _workflow(plan: Plan) -> str:
    """Tests on every Python, and one audit: its verdicts don't hang on the version."""
    versions = ", ".join(f'"{version}"' for version in PYTHONS)
    return f"""name: tests
on: [push, pull_request]
jobs:
  tests:
    runs-on: ubuntu-latest
    strategy:
      matrix:
        python: [{versions}]
    steps:
      - uses: actions/checkout@v4
      - uses: actions/setup-python@v5
        with:
          python-version: ${{{{ matrix.python }}}}
      - run: python -m pip install -e .[test]
      - run: python -m pytest
  audit:
    runs-on: ubuntu-latest
    steps:
      - uses: actions/checkout@v4
      - uses: actions/setup-python@v5
        with:
          python-version: "{PYTHONS[-1]}"
      - run: python -m pip install -e .
      - run: {audit_line(plan)} --out audits
      - uses: actions/upload-artifact@v4
        if: failure()
        with: {{ name: audits, path: audits }}   # each finding's program
"""


def _readme(plan: Plan) -> str:
    listed = "\n".join(f"{number}. {rule}" for number, rule in enumerate(rules(plan), start=1))
    return f"""# {plan.class_name}

A multi-agent environment in PettingZoo's {"AEC" if plan.api == "aec" else "Parallel"} interface:
{plan.why}.

    python -m pip install -e ".[test]"
    python -m pytest
    {audit_line(plan)}
    gamekeeper run {spec_of(plan)} --policy reference

## What is yours to write

Everything works already, with rules that stand in for yours:

{listed}

What to do with them:

1. Replace the rules in `src/{plan.name}/env.py` one by one, each with its test in
   `tests/test_rules.py`.
2. Keep `src/{plan.name}/{plan.name}.toml` true: it declares who acts when, who is paid for what and
   who ends whom, and everything is judged against it.
3. Leave `tests/test_promises.py` as it is: it holds whatever the rules are.
4. Audit: the job `audit` in `.github/workflows/tests.yml` fails on a broken promise. What is meant
   to be so gets a line with its reason under `[waivers]` in the contract.
"""
