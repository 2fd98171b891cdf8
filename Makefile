# Two commands do everything: `make demo` tracks the clip that comes with the package, `make test`
# runs every test. Each makes its own virtual environment; the README says the same in plain pip.
PYTHON ?= python3
BASE := .venv/base
DEV := .venv/dev

.PHONY: demo test lint types docs audit clean fuzz guided faults crash disk soak soak-web compat

demo: $(BASE)/.installed
	$(BASE)/bin/entrack demo --out out/demo

test: $(DEV)/.installed
	$(DEV)/bin/python -m pytest -n 2 --dist loadgroup

lint: $(DEV)/.installed
	$(DEV)/bin/ruff check
	$(DEV)/bin/ruff format --check

types: $(DEV)/.installed
	$(DEV)/bin/pyright --pythonpath $(DEV)/bin/python

docs: $(DEV)/.installed
	$(DEV)/bin/mkdocs build --strict --quiet

audit: $(DEV)/.installed
	.ci/audit $(DEV)/bin

# The long forms of the tests of reliability: a line of figures and out/reliability/NAME.json each.
fuzz faults crash disk soak soak-web: $(DEV)/.installed
	OPENCV_LOG_LEVEL=SILENT $(DEV)/bin/python -m reliability.$(subst -,_,$@)

guided: $(DEV)/.installed
	$(DEV)/bin/pip install --quiet atheris
	OPENCV_LOG_LEVEL=SILENT $(DEV)/bin/python -m reliability.guided

compat: $(DEV)/.installed
	$(DEV)/bin/pip install --quiet uv
	$(DEV)/bin/python -m reliability.compat

$(BASE)/.installed: pyproject.toml
	$(PYTHON) -m venv $(BASE)
	$(BASE)/bin/pip install --quiet --editable .
	touch $@

$(DEV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(DEV)
	$(DEV)/bin/pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

clean:
	rm -rf .venv build dist site out
