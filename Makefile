# One environment for everything. It is made once, with what the package itself needs; the first target for developers
# adds their tools. Both are installed again only when the project's own files change.
PYTHON ?= python3
VENV   := .venv
CORE   := $(VENV)/.installed-core
STAMP  := $(VENV)/.installed
BIN    := $(VENV)/bin
PYTEST := -n auto

# without bytecode every process of the tests, and every process that a test starts, would compile all modules again
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup verify test test-all bench docs lint peers pins wheels mutate machines house guests soak coverage clean

setup: $(STAMP)

# no bytecode is made beforehand: most of it is of modules that are never imported
$(CORE): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else f"dem_bridge needs Python 3.11 or newer, found {v[0]}.{v[1]}; name one with: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e .
	@touch $(CORE)

$(STAMP): $(CORE)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[dev]'
	@touch $(STAMP)

verify: $(CORE)
	$(BIN)/dem-bridge verify paper -o reports/latest

# the suite for every commit: tests marked "slow" are left to test-all; kernels are compiled once and not by each process
test: $(STAMP)
	$(BIN)/python -m tests.helpers.compile_kernels
	$(BIN)/python -m pytest $(PYTEST) -m "not slow"

# all tests, and every recipe of docs/inherit.md followed in a copy of the checkout
test-all: $(STAMP)
	$(BIN)/python -m tests.helpers.compile_kernels
	$(BIN)/python -m pytest $(PYTEST)
	$(BIN)/python -m tests.follow_the_page

# all benchmarks; medians are kept in docs/bench.jsonl and compared with the last; ARGS="bench_paper" runs one of them
bench: $(STAMP)
	$(BIN)/python -m tests.bench.history $(ARGS)

# docs/peers.md: one chain in other codes, judged, and the codes graded; their packages are in an environment of their own
peers: $(STAMP)
	test -x $(VENV)-peers/bin/python || $(PYTHON) -m venv $(VENV)-peers
	$(VENV)-peers/bin/python -m pip install --quiet --disable-pip-version-check $$($(BIN)/python -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['peers'])")
	DEM_BRIDGE_PEERS=$(CURDIR)/$(VENV)-peers/bin/python $(BIN)/python docs/recipes/report.py
	DEM_BRIDGE_PEERS=$(CURDIR)/$(VENV)-peers/bin/python $(BIN)/python docs/recipes/grade.py

# docs/_build/index.html; a warning is an error, and all pages are read because a page that is not gives no warning
docs: $(STAMP)
	$(BIN)/python -m sphinx -b html -E -a -W --keep-going -q -j auto docs docs/_build

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/codespell dem_bridge tests docs .ci README.md CHANGELOG.md pyproject.toml Makefile

# new versions in, everything run beside the old ones, what differs listed; see docs/inherit.md
pins: $(STAMP)
	$(PYTHON) .ci/move_pins.py $(ARGS)

# build both files of a release and use the wheel in empty environments; the table of docs/quality.md
wheels:
	$(PYTHON) .ci/wheels.py $(ARGS)

# plant small faults one at a time and count those that no test catches; an hour or more, and it may be interrupted
mutate: $(STAMP)
	$(BIN)/python .ci/mutate.py $(ARGS)

# the tests whose subject is digits, as on other processors and libraries; ARGS="--whole" for the whole suite
machines: $(STAMP)
	$(BIN)/python .ci/machines.py $(ARGS)

# the suite in a copy without the studies, which are guests: nothing else needs them; ARGS are those of pytest
guests: $(STAMP)
	$(BIN)/python .ci/guests.py $(ARGS)

# how the package is built, in numbers: rooms, arrows, circles, sizes; ARGS="--checkout DIR --checkout ." for before and after
house: $(STAMP)
	$(BIN)/python .ci/house.py $(ARGS)

# campaigns that are killed, have no room, or find damaged files and other users, for an hour; not part of CI
soak: $(STAMP)
	$(BIN)/python -m tests.soak --write $(ARGS)

# which branches the tests of `make test` run, a quarter of an hour; the table of docs/quality.md, and assertions that never ran
coverage: $(STAMP)
	$(BIN)/python -m tests.helpers.compile_kernels
	$(BIN)/python -m coverage erase
	$(BIN)/python -m coverage run -m pytest $(PYTEST) -m "not slow"
	$(BIN)/python -m coverage combine -q
	$(BIN)/python .ci/coverage_table.py

clean:
	rm -rf $(VENV) $(VENV)-new reports/latest docs/_build .coverage*
