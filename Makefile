# Every target makes .venv with pip where it is missing or older than pyproject.toml; a bare Python 3.11 is enough.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
# Thin products gain nothing from BLAS threads, and lose a lot on a busy machine.
export OPENBLAS_NUM_THREADS ?= 1
# Without bytecode every process compiles what it imports, and two workers all tests: half a minute.
unexport PYTHONDONTWRITEBYTECODE
# One process for each core; tests of one file share their fixtures, so that a file stays in one process.
IN_PARALLEL ?= --numprocesses 2 --dist loadfile --quiet

.PHONY: demo check test lint docs results outside paper clean

$(VENV)/.made: pyproject.toml
	@echo "Making $(VENV): pip installs rpil and the tools of its tests, which takes about three minutes."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

demo: $(VENV)/.made
	$(BIN)/rpil demo

# For the inner loop: a minute on two cores (100 seconds of CPU).
check: lint
	$(BIN)/python -m pytest $(IN_PARALLEL) -m "not slow"

# Everything: four minutes on two cores (six and a half minutes of CPU).
test: $(VENV)/.made
	$(BIN)/python -m pytest $(IN_PARALLEL)

lint: $(VENV)/.made
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python tools/lint_words.py

# The site, in build/docs; a warning is an error, and so is a page that loads something from elsewhere. Half a minute.
docs: $(VENV)/.docs
	rm -rf build/docs build/doctrees docs/gallery docs/reference/generated
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -d build/doctrees docs build/docs
	! grep -rE '<(script|link|img)[^>]* (src|href)="(https?:)?//' build/docs --include='*.html'

$(VENV)/.docs: $(VENV)/.made
	@echo "Adding Sphinx to $(VENV) with pip, which takes about a minute."
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	touch $@

# docs/results.md and docs/speed.md from one commit (benchmarks/README.md has times); what is finished is not done again. DATA holds NPZ
# files.
DATA ?= ../shared/data

results: $(VENV)/.made
	$(BIN)/python benchmarks/results.py --data $(DATA) --processes 2
	$(BIN)/python benchmarks/speed.py --data $(DATA) --json build/figures/speed.json --page docs/speed.md

# docs/outside.md and all its tables from one commit: a night. Worlds whose packages are not installed are left out.
OUTSIDE = build/outside/$(shell git rev-parse --short=12 HEAD)

outside: $(VENV)/.made
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable benchmarks/outside
	$(BIN)/python -m rpil_outside night --seeds 3 --json $(OUTSIDE)
	$(BIN)/python -m rpil_outside table $(OUTSIDE) --brief --page docs/outside.md
	$(BIN)/python -m rpil_outside table $(OUTSIDE) --page benchmarks/outside/tables.md

# The paper's Tables 1-6 and Figures 1-7: some minutes for each table.
PAPER ?= build/paper

paper: $(VENV)/.made
	mkdir -p $(PAPER)
	$(BIN)/python benchmarks/paper.py --json $(PAPER)/paper.json --output $(PAPER)

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache .mypy_cache build dist docs/gallery docs/reference/generated rpil-demo.html
