# make demo [VIDEO=path]   segment a video (without VIDEO: a synthetic clip, scored)
# make test                the tests
# make check               tests, then style, types, layers and the installed wheel
# make coverage            the tests, and which lines they do not reach
# Each sets up what it needs in .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test check check-style coverage clean

demo: $(READY)
ifdef VIDEO
	$(BIN)/zsmoseg run "$(VIDEO)"
else
	$(BIN)/zsmoseg demo
endif

test: $(READY)
	$(BIN)/python -m pytest -n 3 --dist loadfile

check: test check-style

check-style: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/installed_wheel.py

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	touch $(READY)

coverage: $(READY)
	$(BIN)/python -m pytest --cov=zsmoseg --cov-report=term:skip-covered

clean:
	rm -rf $(VENV) build dist *.egg-info
