# Two commands set everything up on a Debian or Ubuntu that has only Python and make: `make demo`, `make test`.

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
BENCHMARKS := $(filter-out __init__,$(patsubst tests/bench/%.py,%,$(wildcard tests/bench/*.py)))

# Taichi has wheels for these and no other versions of Python.
SUPPORTED := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
ifndef PYTHON
PYTHON := $(shell for python in python3 python3.13 python3.12 python3.11; do \
	$$python -c '$(SUPPORTED)' 2>/dev/null && echo $$python && break; done)
endif

# A user's settings for other programs must not choose the renderer or the modules of this one.
unexport MUJOCO_GL PYOPENGL_PLATFORM PYTHONPATH PYTHONHOME
# One test process per core already: Mesa's own threads would only compete with them.
export LP_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help demo test study laws trade stability lint bench clean graphics

# Installs Debian packages if this user may, otherwise prints the line to type and fails.
define apt
	packages="$(1)"; \
	if [ "$$(id -u)" = 0 ]; then sudo=; elif sudo -n true 2>/dev/null; then sudo=sudo; else sudo=none; fi; \
	if [ "$$sudo" = none ] || ! command -v apt-get >/dev/null \
	|| ! { $$sudo apt-get update -qq && $$sudo apt-get install -y -qq --no-upgrade --no-install-recommends $$packages; }; then \
		echo "Missing system packages. Type: sudo apt-get install -y $$packages" >&2; false; \
	fi
endef

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*## /make \1\t/p' $(MAKEFILE_LIST)

demo: $(READY) graphics  ## set up, then simulate, verify and film phenomenon 46 into out/, at 480 pixels
	$(BIN)/physinone run 46 --size 480 -o out/

test: $(READY) graphics  ## set up, then run the test suite, one process per core
	$(BIN)/pytest -q -n auto

study: $(READY) graphics  ## the long tests: reference fidelity, installation into an empty environment
	$(BIN)/pytest -q -n auto -m slow

laws: $(READY)  ## every law, measured: docs/laws.md at reference fidelity, docs/laws-matter.md at standard (an hour)
	$(BIN)/physinone check 1-66 --fidelity reference --report docs/laws.md
	$(BIN)/physinone check 67-71 --report docs/laws-matter.md

trade: $(READY)  ## docs/trade.md and what --tolerance reads: error against cost (two hours; it goes on where it was)
	$(BIN)/physinone trade --study --report docs/trade.md --table physinone_mj/measured/trade.json

stability: $(READY)  ## docs/stability.md and what show reads: the extremes (hours; it goes on where it was stopped)
	$(BIN)/physinone stress --report docs/stability.md --table physinone_mj/measured/stability.json

lint: $(READY)  ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(READY) graphics  ## the benchmarks, one after another
	@set -e; for script in $(BENCHMARKS); do echo "== $$script"; $(BIN)/python -m tests.bench.$$script; done

clean:  ## remove the environment, caches and build outputs, never out/
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml
	@$(if $(PYTHON),$(PYTHON) -c '$(SUPPORTED)',false) || { echo "Python 3.11, 3.12 or 3.13 is needed. Type:\
	 sudo apt-get install -y python3.11 python3.11-venv    or name another: make PYTHON=/path/to/python3.12" >&2; false; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null \
	|| { $(call apt,$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')); }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $@

# Goes on without a picture: the physics does not need one, and each command that does says so in one line.
graphics: $(READY)
	@missing="$$($(BIN)/python -c 'from physinone_mj.doctor import missing_packages; print(*missing_packages())')"; \
	[ -z "$$missing" ] || { $(call apt,$$missing); } || true
