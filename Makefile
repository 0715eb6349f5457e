# Each target does its own set-up: a virtual environment in .venv and the locked requirements, once; again when a lock changes.
# Settings: PYTHON=/path/to/python3   VENV=.venv   ARGS="arguments for pytest"   PARALLEL="-n 0" (one process; prints, breakpoints)

VENV ?= .venv
TRAINER ?= sb3
PARALLEL ?= -n auto --maxprocesses 4 --dist loadfile
PYTHON ?=
ARGS ?=
export PYTHON
unexport PYTHONDONTWRITEBYTECODE # the tests start thousands of processes, each of which would compile what it imports

RUN := $(VENV)/bin/python -m
SOURCES := $(wildcard src tests examples benchmarks)
LOCK := uv pip compile --quiet --generate-hashes --no-emit-index-url --universal --fork-strategy fewest --python-version 3.11
DEMO := warehouse --policy reference

.PHONY: help demo dist test slow-test all-test trainer-test browser-test docs docs-browser-test check nightly seconds format-check lint types format lock clean moved
.DELETE_ON_ERROR:

help:
	@echo "make demo     set up, then record and replay the warehouse task; evidence in runs/demo"
	@echo "make test     set up, then run the quick tests, what a change needs (ARGS='-k replay' hands arguments to pytest)"
	@echo "make check    what must hold before a commit: formatting, lint, types, all tests, the pages"
	@echo "make seconds  run all tests and keep which of them are slow (on a quiet machine)"
	@echo "make nightly  what takes hours: kills by the hundred, every environment of the zoo, trainers by seeds"
	@echo "make trainer-test TRAINER=sb3   the tests of one trainer's adapter, in an environment of its own, $(VENV)-sb3"
	@echo "make docs     build the pages into build/docs, strictly"
	@echo "make browser-test   the report's page in Chromium (installs Debian's where it is missing), in $(VENV)-browser"
	@echo "make docs-browser-test   what \`make docs\` has built, in the same Chromium"
	@echo "make dist     build wheel and sdist into dist/, and check them as an index does (twine, in $(VENV)-dist)"
	@echo "make format   reformat the sources, fix what ruff can fix"
	@echo "make lock     compile requirements/*.txt again (needs uv; UPGRADE=--upgrade for newer versions)"
	@echo "make clean    remove $(VENV), caches and build output; evidence in runs/ stays"

# Replaces the evidence of an earlier demo: recording never writes into a folder that holds something.
demo: $(VENV)/base.stamp
	@rm -rf runs/demo
	$(VENV)/bin/gamekeeper run $(DEMO) --out runs/demo

# Tiers are told apart by measured seconds: tests/tiers.py.
test: $(VENV)/test.stamp
	$(RUN) pytest $(PARALLEL) --tier quick $(ARGS)

slow-test: $(VENV)/test.stamp
	$(RUN) pytest $(PARALLEL) --tier slow $(ARGS)

# Both tiers in one run: no core idles at the end of the first.
all-test: $(VENV)/test.stamp
	$(RUN) pytest $(PARALLEL) --tier all $(ARGS)

# All tests on a quiet machine; their seconds decide which of them are slow from then on.
seconds: $(VENV)/test.stamp
	$(RUN) pytest $(PARALLEL) --write-seconds

# A trainer's pins conflict with another's, so each has its own environment; several gigabytes with torch. Those of CI are locked,
# the others name the versions that their tests were last run with.
TRAINER_LIST = $(firstword $(wildcard requirements/trainers/$(TRAINER).txt requirements/trainers/$(TRAINER).in))
trainer-test:
	@test -n "$(TRAINER_LIST)" || { echo "no trainer of that name; known: $(notdir $(basename $(wildcard requirements/trainers/*.in)))" >&2; exit 1; }
	$(MAKE) $(VENV)-$(TRAINER)/trainer.stamp VENV=$(VENV)-$(TRAINER)
	$(VENV)-$(TRAINER)/bin/python -m pytest -m trainer $(wildcard tests/adapters/test_$(TRAINER)*.py tests/examples/test_$(TRAINER)*.py tests/rollouts/executors/test_$(TRAINER)*.py) $(ARGS)

$(VENV)/trainer.stamp: $(VENV)/home.stamp $(TRAINER_LIST) pyproject.toml
	@requirements/setup.sh install $(VENV) $(TRAINER_LIST)
	@touch $@

# The report's page in the distribution's Chromium, which requirements/browser.sh installs where it may; CHROMIUM=path names another one.
browser-test:
	@requirements/browser.sh
	$(MAKE) $(VENV)-browser/browser.stamp VENV=$(VENV)-browser
	$(VENV)-browser/bin/python -m pytest -m browser tests/browser $(ARGS)

# What `make docs` has built, in the same Chromium.
docs-browser-test:
	$(MAKE) $(VENV)-browser/browser.stamp VENV=$(VENV)-browser
	$(VENV)-browser/bin/python -m pytest -m docs tests/browser $(ARGS)

$(VENV)/browser.stamp: $(VENV)/home.stamp requirements/browser.txt pyproject.toml
	@requirements/setup.sh install $(VENV) requirements/browser.txt
	@touch $@

check: format-check lint types all-test docs

# Every bar by its long command; dates and results go into docs/performance.md. Peers and trainers that aren't installed are named and left out.
nightly: $(VENV)/test.stamp
	$(VENV)/bin/python benchmarks/bars.py --whole --write

# Strictly: a page that nobody links to, a name that isn't there or a heading out of place fails.
docs: $(VENV)/test.stamp docs/checks/index.md
	$(RUN) sphinx -W --keep-going -q -j 3 -b html docs build/docs
	$(RUN) pytest -q -m docs tests/surface/test_built_pages.py
	@echo "build/docs/index.html"

# A page for each check, with a real audit of its faulty environment: made again once a source or such an environment has changed.
docs/checks/index.md: docs/check_pages.py $(shell find src/gamekeeper tests/faults -name '*.py') | $(VENV)/test.stamp
	$(RUN) docs.check_pages docs/checks

# hatchling is locked with the base packages; twine has an environment of its own.
dist: $(VENV)/base.stamp
	@rm -rf dist
	$(RUN) hatchling build
	$(MAKE) $(VENV)-dist/twine.stamp VENV=$(VENV)-dist
	$(VENV)-dist/bin/python -m twine check --strict dist/*

$(VENV)/twine.stamp: $(VENV)/home.stamp
	$(VENV)/bin/python -m pip install --quiet twine
	@touch $@

format-check: $(VENV)/test.stamp
	$(RUN) ruff format --check $(SOURCES)

lint: $(VENV)/test.stamp
	$(RUN) ruff check $(SOURCES)

types: $(VENV)/test.stamp
	$(RUN) mypy

format: $(VENV)/test.stamp
	$(RUN) ruff format $(SOURCES)
	$(RUN) ruff check --fix $(SOURCES)

lock:
	@command -v uv >/dev/null || { echo "make lock needs uv: pip install uv" >&2; exit 1; }
	$(LOCK) $(UPGRADE) --extra fast pyproject.toml requirements/base.in -o requirements/base.txt
	$(LOCK) $(UPGRADE) --extra fast --extra frames --extra plot --extra query --extra video pyproject.toml requirements/base.in requirements/test.in -o requirements/test.txt
	$(LOCK) $(UPGRADE) pyproject.toml requirements/base.in requirements/browser.in -o requirements/browser.txt
	@set -e; for lock in requirements/trainers/*.txt; do trainer=$$(basename $$lock .txt); echo "locking $$trainer"; \
		$(LOCK) $(UPGRADE) --extra fast --extra $$trainer pyproject.toml requirements/base.in requirements/trainers/$$trainer.in -o $$lock; done

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find $(SOURCES) -name __pycache__ -type d -prune -exec rm -rf {} +

# An environment remembers the folder it was made for: a checkout that was copied or moved would run the old place's sources,
# and one whose interpreter is gone runs nothing. Both are made anew.
ifneq ($(shell $(VENV)/bin/python -c '' 2>/dev/null && cat $(VENV)/home.stamp 2>/dev/null),$(CURDIR))
$(VENV)/home.stamp: moved
endif

$(VENV)/home.stamp:
	@requirements/setup.sh make $(VENV)
	@echo '$(CURDIR)' >$@

$(VENV)/base.stamp: $(VENV)/home.stamp requirements/base.txt pyproject.toml
	@requirements/setup.sh install $(VENV) requirements/base.txt
	@touch $@

# After base: it holds the tools that build what comes as source only.
$(VENV)/test.stamp: $(VENV)/base.stamp requirements/test.txt
	@requirements/setup.sh install $(VENV) requirements/test.txt
	@touch $@
