# make setup | demo | test | clean; PYTHON=python3.12 make ... selects the interpreter.
PYTHON ?= python3
VENV := .venv
STAMP := $(VENV)/.installed
ARGS ?=
# A test of the night may take hours; others hang after the time in pyproject.toml.
LONG := -o faulthandler_timeout=14400

.DEFAULT_GOAL := help
.PHONY: help setup demo test colcon coverage docs look hard hard-published safeguards nightly audit soak lint types clean

help:  ## List the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/'

setup: $(STAMP)  ## Create .venv and install everything into it

# Installs again after a change of an installed file; the stamp marks a successful installation.
$(STAMP): setup.py pyproject.toml package.xml constraints.txt $(wildcard launch/* libexec/* params/* rviz/*)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo 'lava_ros needs Python 3.10 or newer; choose one: make PYTHON=python3.12 $(MAKECMDGOALS)' >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check 'pip>=25.1'
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[all]' --group test
	@touch $@

demo: $(STAMP)  ## Simulate a flow on a mountain, live in ROS 2 (ARGS='--help' lists the options)
	$(VENV)/bin/lava ros demo $(ARGS)

test: $(STAMP)  ## Run all tests except those marked nightly, three at a time (ARGS='-k bag' selects)
	$(VENV)/bin/python -m pytest --numprocesses 3 --dist loadfile $(ARGS)

colcon: $(STAMP)  ## Build the package with colcon in an empty workspace, and run its node from there
	$(PYTHON) -m venv build/colcon
	build/colcon/bin/python -m pip install --quiet --disable-pip-version-check 'colcon-common-extensions==0.3.0'
	PYTHONPATH=$(CURDIR)/tests:$$(echo $(CURDIR)/build/colcon/lib/python3.*/site-packages):$$PYTHONPATH $(VENV)/bin/python tests/install/colcon_workspace.py

hard: $(STAMP)  ## Run the hard scenes at every preset on every device, 10 minutes on 2 cores (ARGS='--scene cliff', '--method cells')
	PYTHONPATH=tests $(VENV)/bin/python -m hard.run $(ARGS)

hard-published: $(STAMP)  ## Run the hard scenes at the paper's settings, 10 s each, and list the failures
	PYTHONPATH=tests $(VENV)/bin/python -m hard.run --published $(ARGS)

nightly: $(STAMP)  ## Run the fuzzers with thousands of examples, the tests marked nightly, the node in another folder and the Dockerfile's steps, look up vulnerabilities, try random mutants, and print a table (ARGS='--hypothesis-seed=1')
	@mkdir -p build
	@rm -f build/fuzz.json
	@failed=; export LAVA_FUZZ_FIGURES=build/fuzz.json; \
	$(VENV)/bin/python -m pytest tests/fuzz --hypothesis-profile=nightly --numprocesses auto --dist load $(LONG) $(ARGS) \
	  || failed="$$failed fuzz"; \
	$(VENV)/bin/python -m pytest tests -m nightly --numprocesses auto --dist loadfile $(LONG) \
	  --junitxml=build/nightly.xml || failed="$$failed marked"; \
	PYTHONPATH=tests $(VENV)/bin/python tests/install/installed_node.py || failed="$$failed install"; \
	$(VENV)/bin/python tests/install/image.py || failed="$$failed image"; \
	make --no-print-directory audit || failed="$$failed audit"; \
	$(VENV)/bin/python tests/mutation.py --minutes 30 > build/mutation.txt || failed="$$failed mutation"; \
	cat build/mutation.txt; \
	$(VENV)/bin/python tests/fuzz/table.py build/fuzz.json || failed="$$failed table"; \
	test -z "$$failed" || { echo "failed:$$failed" >&2; exit 1; }

audit:  ## Look up known vulnerabilities of the packages in constraints.txt; fails if a package cannot be looked up
	$(PYTHON) -m venv build/audit
	build/audit/bin/python -m pip install --quiet --disable-pip-version-check 'pip-audit==2.10.1'
	build/audit/bin/pip-audit --strict --no-deps --disable-pip --requirement constraints.txt

soak: $(STAMP)  ## Run a node under load for 30 minutes, and check memory, deadlines and bag (ARGS='--minutes 5')
	PYTHONPATH=tests $(VENV)/bin/python -m soak.soak $(ARGS)

look: $(STAMP)  ## Test reports and the live view in a browser, and MP4 files, with wheels of Chromium and ffmpeg (900 MB)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --group look
	$(VENV)/bin/python -m pytest tests/products/report/test_browser.py tests/watch/test_watch_browser.py tests/products/test_animation.py $(ARGS)

safeguards: $(STAMP)  ## Remove each safeguard in a copy of the package, and check that its test fails
	PYTHONPATH=tests $(VENV)/bin/python -m hard.safeguards $(ARGS)

docs: $(STAMP)  ## Build the pages of docs/ and the API reference in build/docs
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --requirement docs/requirements.txt
	$(VENV)/bin/python -m sphinx -W --keep-going --quiet --builder html docs build/docs

coverage: $(STAMP)  ## Run all tests, and list the lines that no test runs
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check 'coverage==7.17.3'
	$(VENV)/bin/python -m coverage erase
	$(VENV)/bin/python -m coverage run -m pytest --numprocesses 3 --dist loadfile $(ARGS)
	$(VENV)/bin/python -m coverage combine --quiet
	$(VENV)/bin/python -m coverage report

lint: types  ## Check style, types and licences, like the hooks of pre-commit
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check 'ruff==0.17.5' 'reuse==6.2.0'
	$(VENV)/bin/ruff check .
	$(VENV)/bin/reuse lint --quiet

types: $(STAMP)  ## Check only types
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check 'mypy==2.4.1'
	$(VENV)/bin/mypy

clean:  ## Remove the files of make: .venv, the demo's bag and caches
	rm -rf $(VENV) bags/demo build install log dist *.egg-info .pytest_cache
	find lava_ros tests -name __pycache__ -type d -exec rm -rf {} +
