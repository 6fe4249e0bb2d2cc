# make demo-quick: the whole chain on a short film | make demo: on the full one | make install | make test |
# make test-slow | make check | make docs | make clean
PYTHON ?= python3
BIN := .venv/bin
# Bytecode is kept, whatever this shell says: every start of a stage or a test takes 1 to 3 s less.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo demo-quick install test test-slow check docs clean

install: .venv/run.stamp

demo: .venv/run.stamp
	$(BIN)/twin demo

demo-quick: .venv/run.stamp
	$(BIN)/twin demo --quick

test: .venv/dev.stamp
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test-slow: .venv/dev.stamp
	$(BIN)/python -m pytest -n 2 --dist worksteal -m slow

check: .venv/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/mypy

# Runs what has changed of the examples and notebooks, then builds site/; a link that leads nowhere fails.
docs: .venv/docs.stamp
	$(BIN)/python benchmarks/docs/sitepages.py build/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "Built site/: open site/index.html, or python -m http.server -d site, which can search."

clean:
	rm -rf .venv build site *.egg-info .pytest_cache .mypy_cache .ruff_cache

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "softtwin needs Python 3.11 or newer, this is %s: make PYTHON=python3.x ..." % sys.version.split()[0])'
	$(PYTHON) -m venv .venv

# Installed once, and again only when the lock or the packaging changes.
.venv/run.stamp: requirements.lock pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

.venv/dev.stamp: requirements-dev.lock .venv/run.stamp
	$(BIN)/python -m pip install --disable-pip-version-check -r requirements-dev.lock
	@touch $@

.venv/docs.stamp: requirements-docs.lock .venv/run.stamp
	$(BIN)/python -m pip install --disable-pip-version-check -r requirements-docs.lock
	@touch $@
