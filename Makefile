# `make compare` and `make test` need Python 3.11 or newer (PYTHON=... to choose one) and nothing else.
PYTHON ?= python3
WORKERS ?= auto
SHARE := --dist loadfile --no-loadscope-reorder# how tests are shared out: see tests/conftest.py
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

.PHONY: help compare test lint example surfaces sensitivity reliability benchmark clean

help:
	@echo "make compare   run every comparison and write reports/latest"
	@echo "make test      run the tests"
	@echo "make lint      check style, types and the direction of imports"
	@echo "make example   write reports/example anew, and the table and picture of README"
	@echo "make surfaces  write the STL files of the LIGGGHTS decks anew, from their cases"
	@echo "make sensitivity  find what the suite would have caught (hours), and write it to README"
	@echo "make reliability  measure what is survived (more than an hour), and write reports/reliability.md"
	@echo "make benchmark    measure speed and memory (some 40 minutes), and write benchmarks/RESULTS.md"
	@echo "make clean     remove the virtual environment and what the tools left behind"

compare: $(VENV)/installed
	$(BIN)/cmpcheck compare

test: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(WORKERS) $(SHARE)
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n $(WORKERS) $(SHARE) -m nojit tests

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

example: $(VENV)/installed
	$(BIN)/cmpcheck compare --out reports/example --force
	$(BIN)/python tools/example.py

surfaces: $(VENV)/installed
	$(BIN)/python tools/surfaces.py

sensitivity: $(VENV)/installed-test
	$(BIN)/cmpcheck sensitivity --profile full --force
	$(BIN)/python tools/sensitivity.py

reliability: $(VENV)/installed-test
	$(BIN)/python -m benchmarks.reliability

benchmark: $(VENV)/installed
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "cmpcheck needs Python 3.11 or newer; choose one with: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); exit 1; }

$(VENV)/installed: pyproject.toml | $(BIN)/python
	@echo "installing into $(VENV) (a minute or two)"
	@$(PIP) install --editable .
	@touch $@

$(VENV)/installed-test: $(VENV)/installed
	@echo "installing the test tools into $(VENV)"
	@$(PIP) install --editable '.[test]'
	@touch $@
