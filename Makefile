# Each target sets up what it needs on a fresh machine. `make` alone lists them.
BIN := .venv/bin
TOOLS := build/tools
# Three at a time, because most of the long ones wait for programs that they started.
PYTEST := $(BIN)/python -m pytest --numprocesses 3 --dist loadfile --no-loadscope-reorder

.DEFAULT_GOAL := help
.PHONY: help setup test-programs demo test test-compiled test-package release deb man check soak bench bench-quick attacks pictures docs lock audit fmt clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## a virtual environment with the package and its tools
	@tools/bootstrap.sh

demo: setup ## see a worn machine become accurate
	@$(BIN)/pitch-gateway demo

test-programs: # a broker and a browser
	@tools/test_programs.sh

test: setup test-programs check ## everything: checks, unit, property and end-to-end tests
	$(PYTEST)

# Not those of the package: they build one of the sources, and the compiled modules lie among these here.
test-compiled: setup test-programs ## the same tests with the hot path compiled; needs a C compiler
	rm -rf build/compiled
	$(BIN)/python tools/compiled.py build/compiled
	cp -r bench deploy docs systemd tables tests tools Makefile pyproject.toml LICENSE .dockerignore *.md build/compiled/
	cd build/compiled && $(CURDIR)/$(PYTEST) tests --ignore tests/package

release: setup ## what a release consists of, into dist/; RELEASE=--help: what can be left out, or made twice (docs/release.md)
	@$(BIN)/python -m tools.release $(RELEASE)

deb: ## the Debian package for this Debian, into dist/; COMPILED=0: without compiling
	@tools/deb.sh

man: setup ## the man pages, into build/man
	$(BIN)/python tools/man_pages.py build/man

test-package: setup test-programs ## of the tests those of packages and installer, in a bare Debian 12 and 13, and releases made twice; as root
	PACKAGE_TESTS=all $(BIN)/python -m pytest tests/package

check: setup ## formatting, lint, types, layers, doctests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest --quiet --doctest-modules gateway

soak: setup ## the ledger: 2 000 000 random requests through the gateway, each write accounted for
	$(BIN)/python -m tests.ledger --requests 2000000 --seeds 100

bench: setup ## measure it: hot path, comparison, load, memory; about 20 minutes; writes bench/results.md
	$(BIN)/python -m bench.hot_path
	$(BIN)/python -m bench.run

bench-quick: setup ## the same in a few minutes, to see that it works; writes into bench/build
	$(BIN)/python -m bench.run --quick

attacks: setup test-programs ## every attack for some seconds, and what it costs; writes its table into docs/security.md
	$(BIN)/python -m tests.attacks --write

pictures: setup test-programs ## take the pictures of the page and of reports that the documents show
	$(BIN)/python -m tests.pictures
	$(BIN)/python -m tests.report.pictures

docs: setup ## write what the documents have from the code: keys, events, errors, drives
	@$(BIN)/python -m tools.docs

lock: $(TOOLS)/bin/uv ## pin what is installed into deploy/requirements.txt: the newest that pyproject.toml allows
	$(TOOLS)/bin/python tools/lock.py

audit: $(TOOLS)/bin/pip-audit ## ask whether a hole is known in what is pinned, and say so where nobody can be asked
	@$(TOOLS)/bin/python tools/audit.py

$(TOOLS)/bin/%: | setup
	$(BIN)/python -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip install --quiet --disable-pip-version-check $*

fmt: setup ## the only target that edits code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean: ## remove what the other targets made
	rm -rf .venv build dist bench/build .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
