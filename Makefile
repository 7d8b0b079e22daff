# Two commands on a fresh machine: `make rehearsal` and `make test`.

PYTHON ?= python3.11
VENV ?= .venv
RUN = $(VENV)/bin/python -m

.PHONY: rehearsal test check docs clean

rehearsal: $(VENV)/installed
	$(RUN) host_tools rehearse rimu_rotating --limit 55 --out out/rehearsal

test: $(VENV)/installed-dev
	$(RUN) pytest -n 2 --dist loadfile $(PYTEST_OPTIONS)

check: $(VENV)/installed-dev
	$(RUN) ruff format --check .
	$(RUN) ruff check .
	$(RUN) mypy

docs: $(VENV)/installed-dev
	$(RUN) host_tools.contract_page > docs/bus-contract.md
	$(RUN) host_tools.diagnostic_page > docs/diagnostic-table.md
	$(RUN) host_tools.fault_table > docs/faults.md
	RRINS_WRITE_DOCS=1 $(RUN) pytest -q tests/docs

$(VENV)/bin/python:
	@command -v $(PYTHON) >/dev/null || { echo "make: needs $(PYTHON); name another with PYTHON=…" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml | $(VENV)/bin/python
	$(VENV)/bin/pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/installed-dev: pyproject.toml | $(VENV)/bin/python
	$(VENV)/bin/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@ $(VENV)/installed

clean:
	rm -rf $(VENV) out build dist
