# Every target sets up what it needs in .venv; a second run reuses it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test test-all bench lint doctest clean

demo: $(VENV)/installed
	$(BIN)/tempog demo --output demo --force

test: $(VENV)/dev-installed
	$(BIN)/python -m pytest -m "not slow"

test-all: $(VENV)/dev-installed
	$(BIN)/python -m pytest

bench: $(VENV)/bench-installed
	$(BIN)/python benchmarks/run.py

lint: $(VENV)/bench-installed
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy

doctest: $(VENV)/dev-installed
	$(BIN)/python -m pytest --doctest-modules src
	$(BIN)/python -m pytest --doctest-glob="*.md" README.md docs

clean:
	rm -rf $(VENV) demo

$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("tempog needs Python 3.11 or newer; set PYTHON=")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(BIN)/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/dev-installed: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@touch $@

$(VENV)/bench-installed: $(VENV)/dev-installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	@touch $@
