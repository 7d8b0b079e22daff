# Two commands on a fresh machine: `make rehearsal` and `make test`.

PYTHON ?= python3.11
VENV ?= .venv
RUN = $(VENV)/bin/python -m

# Installs the project with an extra. uv takes a third of pip's time; it does not read pip's settings.
PIP = $(VENV)/bin/pip --quiet --disable-pip-version-check install --no-compile
INDEX = $(shell $(VENV)/bin/pip config list 2>/dev/null | sed -n "s/^.*\.index-url='\(.*\)'$$/\1/p" | tail -1)
install = UV_DEFAULT_INDEX=$${UV_DEFAULT_INDEX:-$(INDEX)} $(VENV)/bin/uv pip install --quiet --python $(VENV)/bin/python \
	--editable '.[$(1)]' 2>/dev/null || $(PIP) --editable '.[$(1)]'

.PHONY: rehearsal quick compiled test pages socketcan soak lowest check docs docs-html docs-site wheel changelog clean

# One cycle of the rotation scheme. Bytecode of all libraries takes longer than the run: it is last.
rehearsal: $(VENV)/installed
	$(RUN) rrins rehearse rimu_rotating --duration 1600 --out out/rehearsal
	@$(MAKE) --no-print-directory $(VENV)/bytecode

# Tests of a file share what they start; the longest files begin (tests/conftest.py). Three workers
# for two cores: each waits a third of its time for what it starts.
PYTEST = $(RUN) pytest -n 3 --dist loadfile --no-loadscope-reorder

# A wheel with machine code of what everyday commands call: its first start compiles nothing.
wheel: $(VENV)/installed
	$(RUN) rrins.host_tools.builds.wheel
	$(RUN) pip wheel -q --no-deps --wheel-dir dist .

# The tests between two edits: what computes, and none that is slow.
QUICK = dbc docs firmware_py rrins host_tools/hardware host_tools/scenario host_tools/wire

quick: $(VENV)/installed-dev
	$(PYTEST) -q -m "not slow and not soak and not typed" $(PYTEST_OPTIONS) $(addprefix tests/,$(QUICK))

# Code that most tests need: two workers would wait for each other's.
compiled: $(VENV)/installed-dev
	@$(RUN) tests.processes

# MARKS="not soak" adds what `make pages` runs.
test: compiled
	$(PYTEST) $(if $(MARKS),-m "$(MARKS)") $(PYTEST_OPTIONS)

# The dashboard's page in Chromium, and all that the guides show, typed: two minutes.
pages: $(VENV)/installed-dev
	$(PYTEST) -m "browser or typed" $(PYTEST_OPTIONS)

# On a SocketCAN bus, the kernel's or an emulated machine's.
socketcan: $(VENV)/installed-dev
	.ci/socketcan

# Everything but the browser, at length and with random examples: for a night.
soak: export RRINS_SOAK = 2000000
soak: export RRINS_FUZZ = 1000000
soak: export RRINS_SEEDS = 40
soak: export RRINS_FAULT_RUNS = 30
soak: export RRINS_HOURS = 1000
soak: export RRINS_KILLS = 1000
soak: export RRINS_PAIRS = 5
soak: export RRINS_SCAN_ALL = 1
soak: export RRINS_CONFORM = 1
soak: export RRINS_OWN_FIRMWARE = 1
soak: export RRINS_REAL_TIME = 1
soak: compiled
	$(PYTEST) -m "not browser" --hypothesis-profile soak -o timeout=0 $(PYTEST_OPTIONS)

# The lowest numba that pyproject.toml allows makes code that runs as plain Python does.
LOWEST = $(shell sed -n 's/.*"numba>=\(.*\)",.*/\1/p' pyproject.toml)
lowest: $(VENV)/installed-dev
	$(PIP) --upgrade --target $(VENV)/lowest 'numba==$(LOWEST).*'
	PYTHONPATH=$(VENV)/lowest XDG_CACHE_HOME=$(CURDIR)/$(VENV)/lowest/cache \
		$(RUN) pytest -q -p no:cacheprovider tests/rrins/compiled

check: $(VENV)/installed-dev
	$(RUN) ruff format --check .
	$(RUN) ruff check .
	$(RUN) mypy
	$(VENV)/bin/lint-imports --no-logo --no-cache
	$(VENV)/bin/codespell

docs: $(VENV)/installed-dev
	cd docs && ../$(RUN) generate.fault_numbers
	cd docs && ../$(RUN) generate.contract_page > bus-contract.md
	cd docs && ../$(RUN) generate.diagnostic_page > diagnostic-table.md
	cd docs && ../$(RUN) generate.faults_page > faults.md
	cd docs && ../$(RUN) generate.rooms_table
	cd docs && ../$(RUN) generate.scenario_tables
	cd docs && ../$(RUN) generate.scenario_keys
	cd docs && ../$(RUN) generate.figures
	cd docs && ../$(RUN) generate.tool_pictures
	RRINS_WRITE_DOCS=1 $(RUN) pytest -q -m typed tests/docs/test_typed.py

docs-html: $(VENV)/installed-docs
	$(RUN) sphinx -W --keep-going -q -j auto -b html docs docs/_build/html

# With the page that rehearses in the browser, which `make pages` makes and tests by itself.
docs-site: docs-html
	$(RUN) rrins dashboard --static docs/_build/html/try

$(VENV)/bin/python:
	@command -v $(PYTHON) >/dev/null || { echo "make: needs $(PYTHON); name another with PYTHON=…" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	-@$(PIP) uv 2>/dev/null

$(VENV)/installed: pyproject.toml | $(VENV)/bin/python
	$(call install,web)
	touch $@

# EXTRAS=,docs has pip look at all packages once instead of twice.
$(VENV)/installed-dev: pyproject.toml | $(VENV)/bin/python
	$(call install,dev$(EXTRAS))
	touch $@ $(VENV)/installed
	@$(MAKE) --no-print-directory $(VENV)/bytecode

# Libraries may contain files that are not for this Python: they stay as they are.
$(VENV)/bytecode: $(VENV)/installed
	-@$(RUN) compileall -qq -j 0 -x '/tests/' $(VENV)/lib
	@touch $@

$(VENV)/installed-docs: pyproject.toml | $(VENV)/bin/python
	$(call install,docs)
	touch $@ $(VENV)/installed

changelog: $(VENV)/installed-dev
	$(RUN) towncrier build --yes --version "$$($(VENV)/bin/python -c 'import rrins; print(rrins.__version__)')"

clean:
	rm -rf $(VENV) out build dist docs/_build
