# The project's chores, the same here and in continuous integration. `make demo` and `make test` need nothing but
# Python 3.11+ and, the first time, a package index.

PYTHON ?= python3
VENV ?= .venv
DEMO ?= .venv-demo
DEMO_MODEL ?= .venv-demo-model
BIN := $(VENV)/bin
PIP_OPTIONS := --quiet --disable-pip-version-check
# The tests start thousands of Python processes, which should not compile everything that they import again.
unexport PYTHONDONTWRITEBYTECODE
NEW_ENOUGH := import sys; sys.exit("smartplay-tools needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)

.PHONY: demo demo-model test test-lowest coverage constraints lint types check docs experiment benchmarks release clean

# A marker that is older than its sources means that the environment has to be made again.
# Versions are those of constraints.txt, so that a new release of somebody else's breaks nothing by itself.
$(VENV)/.ready: pyproject.toml constraints.txt .ci/install
	$(PYTHON) -c '$(NEW_ENOUGH)'
	PYTHON=$(PYTHON) .ci/install $(VENV) --constraint constraints.txt --editable '.[all,dev,docs]'
	touch $@

# The demo has an environment of its own, small and made fast: today's pip, which chooses among files several times as
# fast as older ones, put there by the pip that is here if there is one; nothing compiled that is not imported; and the
# package built with what is there already.
$(DEMO)/.ready: pyproject.toml .ci/demo_requirements.py
	$(PYTHON) -c '$(NEW_ENOUGH)'
	$(PYTHON) -m venv --without-pip $(DEMO)
	$(PYTHON) -m pip --python $(DEMO)/bin/python install $(PIP_OPTIONS) --no-compile pip 2> /dev/null || $(PYTHON) -m venv $(DEMO)
	$(PYTHON) .ci/demo_requirements.py > $(DEMO)/requirements.txt
	$(DEMO)/bin/python -m pip install $(PIP_OPTIONS) --no-compile --requirement $(DEMO)/requirements.txt
	$(DEMO)/bin/python -m pip install $(PIP_OPTIONS) --no-compile --no-deps --no-build-isolation --editable .
	touch $@

demo: $(DEMO)/.ready  ## play real games through tool calls under a budget
	$(DEMO)/bin/smartplay-tools demo
	@echo "A real model of 135 million parameters on this machine, without a key (250 MB to download): make demo-model"

# A real model, in an environment of its own: 98 MB of it, 150 MB of packages more than the demo's, and jinja2 for the
# page at the end.
$(DEMO_MODEL)/.ready: pyproject.toml .ci/demo_requirements.py .ci/install
	$(PYTHON) -c '$(NEW_ENOUGH)'
	$(PYTHON) .ci/demo_requirements.py local evaluation:jinja2 > $(DEMO_MODEL).txt
	PYTHON=$(PYTHON) .ci/install $(DEMO_MODEL) --requirement $(DEMO_MODEL).txt
	rm $(DEMO_MODEL).txt
	PYTHON=$(PYTHON) .ci/install $(DEMO_MODEL) --no-deps --no-build-isolation --editable .
	touch $@

demo-model: $(DEMO_MODEL)/.ready  ## the same with a real model of 135 million parameters, which it downloads
	$(DEMO_MODEL)/bin/smartplay-tools model get smollm2-135m-player
	$(DEMO_MODEL)/bin/smartplay-tools demo --player local:smollm2-135m-player

test: $(VENV)/.ready  ## run all tests but the slow ones
	$(BIN)/python -m pytest -n auto --dist loadfile -m 'not slow'

test-lowest:  ## the adapter tests with the lowest versions that are declared
	.ci/lowest

coverage: $(VENV)/.ready  ## the same tests, and which lines they run in their own processes
	$(BIN)/python -m pytest -n auto --dist loadfile -m 'not slow' --cov --cov-report=term:skip-covered

constraints: $(VENV)/.ready  ## renew constraints.txt: the newest versions that pyproject.toml allows
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --no-annotate --no-header \
	    --no-emit-index-url --extra all --extra dev --extra docs pyproject.toml --output-file constraints.txt

lint: $(VENV)/.ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/.ready
	$(BIN)/mypy

check: lint types test  ## what has to be green before a commit

docs: $(VENV)/.ready  ## the documentation as a site, in docs/_build; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -E -b html docs docs/_build

experiment: $(VENV)/.ready  ## what a smaller context costs: play it, draw it, print it
	$(BIN)/python experiments/context.py

benchmarks: $(VENV)/.ready  ## measure, and print tables
	for file in $(filter-out benchmarks/cache.py,$(wildcard benchmarks/*.py)); do $(BIN)/python $$file || exit 1; done

release: $(VENV)/.ready  ## what is uploaded to a package index, in dist/, and tried; CONTRIBUTING.md says when
	.ci/release $(BIN)/python

clean:
	rm -rf $(VENV) $(DEMO) $(DEMO_MODEL) build dist docs/_build docs/jupyter_execute .hypothesis .mypy_cache .pytest_cache .ruff_cache
