# The project's chores, the same here and in continuous integration. `make demo` and `make test` need nothing but
# Python 3.11+ and, the first time, a package index.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo test lint types check benchmarks clean

# A marker that is older than pyproject.toml means that the environment has to be made again.
$(VENV)/.ready: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("smartplay-tools needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[all,dev]'
	touch $@

demo: $(VENV)/.ready  ## play real games through tool calls under a budget
	$(BIN)/smartplay-tools demo

test: $(VENV)/.ready  ## run all tests but the slow ones
	$(BIN)/python -m pytest -n auto -m 'not slow'

lint: $(VENV)/.ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/.ready
	$(BIN)/mypy

check: lint types test  ## what has to be green before a commit

benchmarks: $(VENV)/.ready  ## measure, and print tables
	for file in benchmarks/[a-z]*.py; do $(BIN)/python $$file || exit 1; done

clean:
	rm -rf $(VENV) build dist .hypothesis .mypy_cache .pytest_cache .ruff_cache
