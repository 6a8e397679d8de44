# `make run` on a fresh machine: environment and the whole default workflow. `make help` lists the rest.

PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3.14 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
# Debian's python3 without python3-venv has pip, but cannot put it into a new environment by itself.
WITHOUT_ENSUREPIP := ($(PYTHON) -m venv --clear --without-pip $(VENV) && $(PYTHON) -m pip --python $(BIN)/python install pip)
CORES ?= 2
PYTEST ?=
export PATH := $(CURDIR)/$(BIN):$(PATH)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_ROOT_USER_ACTION := ignore

.DEFAULT_GOAL := help
.PHONY: help run env test lint config bench measured pins clean

help:  ## say what there is
	@sed -n 's/^\([a-z]*\):.*##/make \1\t/p' $(MAKEFILE_LIST) | expand -t 14

run: env  ## environment, then everything that config/config.yaml asks for (CORES=2)
	snakemake --cores $(CORES)

env: $(VENV)/.installed  ## the environment alone, in .venv

test: env $(VENV)/.node  ## environment, then all tests (PYTEST="-k name" for some)
	pytest $(PYTEST)

lint: env  ## ruff, snakefmt, snakemake --lint and the house's figures
	ruff check .
	ruff format --check .
	snakefmt --line-length 120 --check Snakefile workflow
	snakemake --lint
	python tools/house.py

config: env  ## budget schema, paper.yaml and the documents' tables of keys, from the Settings in src/
	python tools/config.py

bench: env  ## the benchmarks beside each hot path; what they print is kept in results/measured/
	@mkdir -p results/measured
	@set -e; for script in benchmarks/bench_*.py; do echo "== $$script"; kept=results/measured/$$(basename $$script .py).txt; \
		python $$script > $$kept || { cat $$kept; exit 1; }; cat $$kept; done

measured: env  ## put the tables of results/ into docs/measured/
	python tools/measured.py

clean:  ## remove caches; results/, .snakemake/ and .venv stay
	rm -rf .pytest_cache .ruff_cache .hypothesis build dist
	find src tests workflow benchmarks tools -name __pycache__ -prune -exec rm -rf {} +

pins:  ## find newer versions of everything and write envs/requirements.txt (needs a network)
	envs/pins.sh $(PYTHON) > requirements.new
	mv requirements.new envs/requirements.txt
	@echo "now: make env && python tools/licences.py"

$(VENV)/.installed: envs/requirements.txt pyproject.toml
	@test -n "$(PYTHON)" || { echo "cospeech needs Python 3.11 or newer; set PYTHON=/path/of/python" >&2; exit 1; }
	$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV) || $(WITHOUT_ENSUREPIP)
	$(BIN)/python -m pip install --quiet --requirement envs/requirements.txt
	$(BIN)/python -m pip install --quiet --no-deps --editable .
	touch $@

# Independent readers of BVH and GLB for the tests, which are skipped without npm.
$(VENV)/.node: tests/package.json $(VENV)/.installed
	@if command -v npm >/dev/null && npm install --prefix tests --no-package-lock --silent; then touch $@; \
	else echo "no three.js and glTF validator (npm): the tests that need them are skipped"; fi
