# make setup | demo | test | clean; PYTHON=python3.12 make ... selects the interpreter.
PYTHON ?= python3
VENV := .venv
STAMP := $(VENV)/.installed
ARGS ?=

.DEFAULT_GOAL := help
.PHONY: help setup demo test docs clean

help:  ## Say what can be made
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /  make \1\t/'

setup: $(STAMP)  ## Create .venv and install everything into it

# Installs again when what is installed has changed; the stamp says that it went through.
$(STAMP): setup.py setup.cfg pyproject.toml package.xml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo 'lava_ros needs Python 3.10 or newer; choose one: make PYTHON=python3.12 $(MAKECMDGOALS)' >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[all]'
	@touch $@

demo: $(STAMP)  ## Let lava flow down a mountain, live in ROS 2 (ARGS='--help' lists the options)
	$(VENV)/bin/lava demo $(ARGS)

test: $(STAMP)  ## Run every test (ARGS='-k bag' selects)
	$(VENV)/bin/python -m pytest $(ARGS)

docs: $(STAMP)  ## Build the pages of docs/, API reference included, into build/docs
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --requirement docs/requirements.txt
	$(VENV)/bin/python -m sphinx -W --keep-going --quiet --builder html docs build/docs

clean:  ## Remove what make made: .venv, the demo's bag and caches
	rm -rf $(VENV) bags/demo build install log dist *.egg-info .pytest_cache
	find lava_ros tests -name __pycache__ -type d -exec rm -rf {} +
