# Two commands: `make demo` flies the paper's experiment, `make test` proves it.
PYTHON ?= python3
VENV := .venv
PYTHONS := 3.11 3.12 3.13
HEART := tests/description/test_description.py tests/description/test_portability.py tests/description/test_other_tools.py \
	tests/robot/test_identities.py tests/observers/test_observers.py tests/experiments/test_paper_experiment.py \
	tests/cli/test_cli.py
# Each writes the pages and figures that its first line names.
SCRIPTS := pictures lifting_line/lifting_line section_law screenshots studies results crank frames observer_study
BIN := $(VENV)/bin

.PHONY: demo test test-python coverage docs bench clean

demo: $(VENV)/.installed
	$(BIN)/aerobat run paper --force

test: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest
	@for version in $(PYTHONS); do $(MAKE) --no-print-directory test-python VERSION=$$version || exit 1; done

# The heart of the tests on every other supported Python that is installed here.
test-python:
	@if python$(VERSION) -c '' 2>/dev/null && ! $(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] != tuple(map(int, "$(VERSION)".split("."))))'; then \
		echo "Python $(VERSION):"; \
		test -x $(VENV)-$(VERSION)/bin/python || python$(VERSION) -m venv $(VENV)-$(VERSION); \
		$(VENV)-$(VERSION)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[test]' && \
		$(VENV)-$(VERSION)/bin/python -m pytest $(HEART); \
	fi

# Lines of aerobat_pin that no test runs; processes that tests start count too.
coverage: $(VENV)/.installed-test
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --fail-under=95

bench: $(VENV)/.installed
	$(BIN)/python benchmarks/bench.py $(ARGS)

docs: $(VENV)/.installed-test
	@for script in $(SCRIPTS); do \
		echo "docs/scripts/$$script.py"; \
		PYTHONPATH=tests $(BIN)/python docs/scripts/$$script.py || exit 1; \
	done

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.installed-test: pyproject.toml $(VENV)/.installed | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	touch $@

clean:
	rm -rf $(VENV) $(VENV)-3.* build *.egg-info runs
