# Every target makes .venv with pip where it is missing or older than pyproject.toml; a bare Python 3.11 is enough.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
# Thin products gain nothing from BLAS threads, and lose a lot on a busy machine.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test lint clean

$(VENV)/.made: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

demo: $(VENV)/.made
	$(BIN)/rpil demo

test: $(VENV)/.made
	$(BIN)/python -m pytest

lint: $(VENV)/.made
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache .mypy_cache build dist rpil-demo.html
