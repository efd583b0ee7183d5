# What to do with a checkout: `make help` lists it. Everything runs in .venv, which is made from requirements.lock
# the first time something needs it, and again when the lock changes.

PYTHON ?= python3
ARGS ?=

BIN := .venv/bin
LOCKED := .venv/.locked
READY := .venv/.ready
PIP := $(BIN)/python -m pip install -qq --disable-pip-version-check
PACKAGES := coevo behaviors analysis
# A process for each core. Each begins with a stretch of the tests as they are ordered, so that what tests of a file share
# is made once; who has finished takes from the others. `-n 0` in ARGS: in one process, as for a debugger.
PARALLEL := -n auto --dist worksteal
# Threads of BLAS wait for each other where processes share the cores: what takes a second then takes six.
test coverage docs-check: export OPENBLAS_NUM_THREADS = 1

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help evolve test coverage env lint format types imports wheel-check docs-check hooks skills bench browser attack screenshots lock clean

help: ## show this list
	@echo 'make TARGET [ARGS="..."] [PYTHON=python3.12]'
	@sed -n 's/^\([a-z-]*\):[^#]*## \(.*\)/  \1	\2/p' $(MAKEFILE_LIST) | expand -t 16

evolve: $(READY) ## co-evolve three robots that play soccer: make evolve ARGS="--seed 3"
	@$(BIN)/coevo evolve three-learners $(ARGS)

test: $(READY) ## run the tests on all cores: make test ARGS="-m 'not slow'"
	@$(BIN)/python -m pytest $(PARALLEL) $(ARGS)

coverage: $(READY) ## run the tests, and tell what they do not reach
	@$(BIN)/python -m pytest $(PARALLEL) --cov $(ARGS)

env: $(READY) ## make the environment, if it is not there or out of date

lint: $(READY) ## check style and format
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check

format: $(READY) ## mend what ruff can mend
	@$(BIN)/ruff check --fix-only
	@$(BIN)/ruff format

types: $(READY) ## check types
	@$(BIN)/mypy

imports: $(READY) ## check that imports respect the borders in pyproject.toml
	@$(BIN)/lint-imports --no-logo

wheel-check: $(READY) ## build the wheel, install it in a fresh environment and use it there
	@$(BIN)/python tools/wheel_check.py

docs-check: $(READY) ## check every command of the documentation, and run those that do not take long
	@$(BIN)/python tools/documented_commands.py $(ARGS)

hooks: $(READY) ## let git check style, types, imports and documentation before each commit
	@$(BIN)/pre-commit install

skills: $(READY) ## learn the installed skills anew from their recipes, and measure them (about 20 minutes)
	@for skill in shoot pass avoid search shoot-in-view pass-in-view home defend; do \
		$(BIN)/coevo learn $$skill --restart --out behaviors/pretrained/$$skill || exit 1; \
	done

bench: $(READY) ## measure speed: the benchmarks in tests/, then `coevo bench`
	@$(BIN)/python -m pytest tests/benchmarks --benchmark-enable --benchmark-only
	@$(BIN)/coevo bench $(ARGS)

browser: ## install Chromium, which tries the pages in the tests, if there is none (Debian and its kin, as root)
	@for name in chromium chromium-browser google-chrome google-chrome-stable chrome; do \
		command -v $$name >/dev/null && exit 0; done; \
	command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ] || { \
		echo 'There is no Chromium, and it cannot be installed from here: install the package chromium.' >&2; exit 1; }; \
	echo 'Installing Chromium ...'; \
	apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium >/dev/null

attack: $(READY) ## attack coevo: kills, crashes, damage, races, hostile input (half an hour): make attack ARGS="--scale 0.1"
	@$(BIN)/python tools/attack $(ARGS)

screenshots: $(READY) ## make the pictures of the README again: make screenshots ARGS="runs/three-learners-seed0"
	@$(BIN)/python tools/screenshots.py $(ARGS)

lock: ## remake requirements.lock from pyproject.toml: make lock ARGS=--upgrade
	@echo 'Remaking requirements.lock from pyproject.toml ...'
	@test -x .venv-lock/bin/uv || $(PYTHON) -m venv .venv-lock
	@test -x .venv-lock/bin/uv || .venv-lock/bin/python -m pip install -qq --disable-pip-version-check uv
	@.venv-lock/bin/uv pip compile --quiet pyproject.toml --extra cluster --extra report --group dev \
		--universal --python-version 3.11 --fork-strategy fewest --only-binary :all: --generate-hashes \
		--no-config --no-emit-index-url --no-emit-find-links --custom-compile-command 'make lock' \
		--output-file requirements.lock $(ARGS)
	@if grep -nE 'https?:|file:|^-' requirements.lock; then \
		echo 'requirements.lock should hold names, versions and hashes only; take the lines above out'; exit 1; fi

clean: ## remove the environments, caches and builds; runs stay
	rm -rf .venv .venv-lock build dist htmlcov .coverage .coverage.* .benchmarks .hypothesis .import_linter_cache
	rm -rf .mypy_cache .pytest_cache .ruff_cache
	find $(wildcard $(PACKAGES) tests tools) -name __pycache__ -type d -prune -exec rm -rf {} +

$(LOCKED): requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "coevo needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version 2>/dev/null || echo 'not there')." \
			"Name another, as in 'make env PYTHON=python3.12'." >&2; exit 1; }
	@echo "Making the environment .venv ($$($(PYTHON) --version)) ..."
	@$(PYTHON) -m venv --clear .venv
	@echo 'Installing the locked packages: a minute or two, only this once ...'
	@$(PIP) --require-hashes --no-deps -r requirements.lock
	@touch $@

$(READY): pyproject.toml $(LOCKED)
	@echo 'Installing coevo from this checkout ...'
	@$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@
