# Two commands: `make demo` flies the paper's experiment, `make test` proves it.
PYTHON ?= python3
VENV := .venv
# What shares the cores with others multiplies matrices by one thread.
export OPENBLAS_NUM_THREADS ?= 1
# Where Python may not write what it compiled, each of hundreds of programs compiles all its libraries again.
export PYTHONDONTWRITEBYTECODE :=
PYTHONS := 3.11 3.12 3.13
HEART := tests/description/test_description.py tests/description/test_portability.py \
	tests/aerobat/test_identities.py tests/observers/test_observers.py tests/experiments/test_paper_experiment.py \
	tests/cli/test_cli.py
# Each writes the pages and figures that its first line names.
SCRIPTS := pictures lifting_line/lifting_line section_law screenshots studies results crank frames \
	observer_study structural_error method real_recordings strange_arms
BIN := $(VENV)/bin
# Without --no-compile, Python's copies of modules that nobody imports take 130 MB.
PIP := -m pip install --quiet --no-compile --disable-pip-version-check
# Tests of a file stay together, as they share flights; the longest files come first (tests/conftest.py). One process
# more than there are cores makes it no faster.
PARALLEL := -n logical --maxprocesses 4 --dist loadfile --no-loadscope-reorder
# Says which Python was found and which would do, and how to name it; exit code 1 for one that would not do.
RIGHT_PYTHON = -c 'import sys; v = sys.version_info[:2]; ok = (3, 11) <= v <= (3, 13); ok or print("%s is Python %d.%d: Python 3.11 to 3.13 was expected; name one, as in: make PYTHON=python3.12 $(or $(MAKECMDGOALS),demo)" % (sys.argv[1], *v), file=sys.stderr); sys.exit(not ok)'

.PHONY: demo test test-python test-lowest coverage mutants docs reproduce site bench reliability evidence tools clean

demo: $(VENV)/.installed
	$(BIN)/aerobat run paper --force

test: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	PROGRAMS_PYTHONOPTIMIZE=$$PYTHONOPTIMIZE PYTHONOPTIMIZE= $(BIN)/python -m pytest $(PARALLEL)
	@for version in $(PYTHONS); do $(MAKE) --no-print-directory test-python VERSION=$$version || exit 1; done

# The heart of the tests on every other supported Python that is installed here.
test-python:
	@if python$(VERSION) -c '' 2>/dev/null && ! $(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] != tuple(map(int, "$(VERSION)".split("."))))'; then \
		echo "Python $(VERSION):"; \
		test -x $(VENV)-$(VERSION)/bin/python || python$(VERSION) -m venv $(VENV)-$(VERSION); \
		$(VENV)-$(VERSION)/bin/python $(PIP) --editable '.[test]' && \
		$(VENV)-$(VERSION)/bin/python -m pytest $(PARALLEL) $(HEART); \
	fi

# The heart of the tests with the oldest version of everything that pyproject.toml allows, Python's too.
test-lowest: $(VENV)/.installed-test
	test -x $(VENV)-lowest/bin/python || $(word 1,$(foreach one,$(PYTHONS),$(shell command -v python$(one)))) -m venv $(VENV)-lowest
	$(BIN)/python tests/support/lowest.py > $(VENV)-lowest/constraints.txt
	$(VENV)-lowest/bin/python $(PIP) --constraint $(VENV)-lowest/constraints.txt --editable '.[test]'
	$(VENV)-lowest/bin/python -m pytest $(PARALLEL) $(HEART)

# Lines of aerobat_pin that no test runs; processes that tests start count too.
coverage: $(VENV)/.installed-test
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report --fail-under=95

# Which classical slips would no test notice? Some ten minutes.
mutants: $(VENV)/.installed-test
	$(BIN)/python tests/mutants.py $(ARGS)

# AGAINST=rev: beside another commit, measured in turn.
bench: $(VENV)/.installed
	$(BIN)/python benchmarks/bench.py $(if $(AGAINST),--against $(AGAINST)) $(ARGS)

# Thousands of bad inputs through all doors, and the page of their counts; ARGS="--count 5000 --seeds 1 2 3".
reliability: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python benchmarks/bad_inputs.py $(ARGS)

# Counts that take an hour: pages with a date; each script ends with an error if a figure is not reached.
evidence: $(VENV)/.installed-test
	$(BIN)/python -m pytest $(PARALLEL) -m evidence
	PYTHONPATH=tests $(BIN)/python benchmarks/broken_runs.py
	PYTHONPATH=tests $(BIN)/python benchmarks/learnt_error.py
	PYTHONPATH=tests $(BIN)/python benchmarks/legs.py
	PYTHONPATH=tests $(BIN)/python benchmarks/named_robots.py
	PYTHONPATH=tests $(BIN)/python benchmarks/stream_faults.py
	PYTHONPATH=tests $(BIN)/python benchmarks/ros_node.py
	PYTHONPATH=tests $(BIN)/python benchmarks/extras.py
	$(MAKE) --no-print-directory test-lowest
	PYTHONPATH=tests $(BIN)/python benchmarks/live.py

# The robot's files in other people's tools, each in an environment of its own in .venv-tools/: some gigabytes at first.
tools: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python benchmarks/other_tools.py $(ARGS)

docs: $(VENV)/.installed-test
	@for script in $(SCRIPTS); do \
		echo "docs/scripts/$$script.py"; \
		PYTHONPATH=tests $(BIN)/python docs/scripts/$$script.py || exit 1; \
	done

# The figures of the paper, the numbers and figures of README, and how long each script took; needs a Chromium.
reproduce: $(VENV)/.installed-test
	@for script in pictures method results screenshots; do \
		begin=$$(date +%s); \
		PYTHONPATH=tests $(BIN)/python docs/scripts/$$script.py || exit 1; \
		echo "docs/scripts/$$script.py: $$(($$(date +%s) - begin)) s"; \
	done

# The pages of docs/ as a site in build/site/html, which needs no network.
site: $(VENV)/.installed-docs
	PYTHONOPTIMIZE= $(BIN)/python docs/site/build.py

# A .venv of a wrong Python, or half a one, is not left behind: the next `make demo` would find it.
$(BIN)/python:
	@$(PYTHON) $(RIGHT_PYTHON) $(PYTHON)
	@echo "making $(VENV) with `$(PYTHON) --version`"
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt-get install python3-venv" >&2; exit 1; }

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	@$(BIN)/python $(RIGHT_PYTHON) $(VENV) || { echo "then remove the old one: make clean" >&2; exit 1; }
	@echo "installing about 70 packages into $(VENV): 994 MiB on disk, some minutes; pip says nothing meanwhile"
	$(BIN)/python $(PIP) --editable .
	touch $@

$(VENV)/.installed-test: pyproject.toml $(VENV)/.installed | $(BIN)/python
	@echo "installing what the tests need: about 75 more packages, 1 GB on disk, some minutes; pip says nothing meanwhile"
	$(BIN)/python $(PIP) --editable '.[test]'
	$(BIN)/python $(PIP) --editable '.[ros2]' 2>/dev/null || \
		echo "ROS 2 has no package for this Python and system: the node's test will be skipped"
	touch $@

$(VENV)/.installed-docs: pyproject.toml $(VENV)/.installed | $(BIN)/python
	@echo "installing what the site needs: about 40 packages, 70 MB"
	$(BIN)/python $(PIP) --editable '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) $(VENV)-3.* $(VENV)-lowest $(VENV)-tools build *.egg-info runs
