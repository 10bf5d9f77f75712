# Each target works alone on a fresh clone: it makes .venv and installs what it needs, once.
#
#   make live    a closed linkage in the browser, dragged with the mouse
#   make demo    the paper's experiment, into demo/
#   make test    lint, types, tests; of sweeps over seeds, states and values a sample
#   make test-long   the same with whole sweeps
#   make lint    lint and types only
#   make bench   accuracy, ablation, speed and graphs, for hours, into bench/; ONE=speed: one
#   make campaign   every fault against the graph, for hours, into reliability/; QUICK=1: minutes
#   make small-machine   the demo on two CPUs: alone, busy, with a quota; ten times, QUICK=1: once
#   make docs    the documentation as a site, into site/
#   make wheel   a wheel with compiled kernels, into dist/: machines that install it compile nothing
#   make clean   remove everything that was made here, .venv too
#
# Another interpreter: make test PYTHON=python3.12

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.SUFFIXES:
MAKEFLAGS += --no-builtin-rules

PACKAGE := hapticmech_ros
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
# People may have told pip to prefer --user, which .venv cannot have.
export PIP_USER := 0

# .venv holds a ROS 2 of its own, from PyPI. Mixed with a sourced ROS 2 (its Python packages, its
# libraries, a middleware that only it has) neither works: what sourcing set is taken away here.
ifneq ($(AMENT_PREFIX_PATH)$(ROS_DISTRO)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE),)
unexport LD_LIBRARY_PATH
endif
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH ROS_DISTRO ROS_VERSION
unexport ROS_PYTHON_VERSION RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV

# .venv remembers where it was made and by which interpreter: scripts in it name both.
MADE_HERE := $(shell sed -n 1p .venv/made 2>/dev/null)
MADE_BY := $(shell sed -n 2p .venv/made 2>/dev/null)
# Somebody else's .venv has no such file, and stays.
FOREIGN := $(if $(wildcard .venv/made),,$(wildcard .venv))
ifneq ($(MADE_HERE),$(CURDIR))
.PHONY: .venv/made
else ifeq ($(origin PYTHON),file)
PYTHON := $(MADE_BY)
else ifneq ($(MADE_BY),$(PYTHON))
.PHONY: .venv/made
endif

REQUIREMENTS := pyproject.toml setup.cfg setup.py
# Folders too: one is newer when a file in it was removed.
SOURCES := package.xml $(shell find $(PACKAGE) config launch resource \
  -name __pycache__ -prune -o -print 2>/dev/null)

.PHONY: help
help:
	@sed -n '3,14s/^# *//p' Makefile

.PHONY: live
live: .venv/package
	$(BIN)/hapticmech live five_bar

.PHONY: demo
demo: .venv/package
	$(BIN)/hapticmech demo --out demo

# Graphs of nodes mostly wait: two at a time; what is timed, one after the other. Thousands of other
# tests are in other folders, and are not collected for them.
GRAPHS := test/ros test/live
.PHONY: test test-long
test-long: SWEEPS := --long
test-long: test
test: lint
	$(BIN)/pytest -m 'not ros and not alone' -n auto --dist worksteal $(SWEEPS)
	$(BIN)/pytest $(GRAPHS) -m 'ros and not alone' -n 2 --dist worksteal
	$(BIN)/pytest $(GRAPHS) -m alone

.PHONY: lint
lint: .venv/test-requirements .venv/package
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/mypy

# In .venv alone: what the tests need is not needed here.
BENCHMARKS := accuracy ablation speed graph
.PHONY: bench
bench: .venv/bench-requirements .venv/package
	set -e; for one in $(or $(ONE),$(BENCHMARKS)); do \
	  $(BIN)/python -m benchmarks $$one $(OPTIONS) --out bench; done

.PHONY: campaign
campaign: .venv/bench-requirements .venv/package
	$(BIN)/python -m benchmarks.reliability $(if $(QUICK),--quick) --out reliability $(PARTS)

.PHONY: small-machine
small-machine: .venv/package
	$(BIN)/python -m benchmarks small_machine $(if $(QUICK),--quick) --out bench $(OPTIONS)

.PHONY: docs
docs: .venv/docs-requirements .venv/package
	rm -rf docs/api
	$(BIN)/python -m sphinx -W --keep-going -q . site
	@echo 'Open site/index.html in a browser: file://$(CURDIR)/site/index.html'

# Machine code for x86-64 processors since 2015, and for this version of Python.
COMPILED := $(PACKAGE)/compilation/x86-64-v3.zip
.PHONY: wheel
wheel: .venv/requirements
	trap 'rm -rf build $(COMPILED)' EXIT; set -e; \
	$(BIN)/python -m $(PACKAGE).compilation.builder x86-64-v3 $(COMPILED) $$$$; \
	tag=$$($(BIN)/python -c 'import sys; print("cp%d%d" % sys.version_info[:2])'); \
	$(PIP) wheel --quiet --no-deps --no-build-isolation --wheel-dir dist . \
	  --config-settings=--build-option="--plat-name=manylinux_2_17_x86_64 --python-tag=$$tag"

.PHONY: clean
clean:
	$(if $(FOREIGN),@echo '.venv is kept: make did not make it.',rm -rf .venv)
	rm -rf build dist demo bench feel reliability docs/api site install log $(PACKAGE).egg-info
	rm -rf .coverage .mypy_cache .pytest_cache .ruff_cache
	find . -name .git -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

# Kept where making .venv fails or is interrupted: what make began is not somebody else's.
.PRECIOUS: .venv/made
.venv/made:
	@$(if $(FOREIGN),echo 'error: make did not make .venv and does not replace it: remove it (rm -r .venv)\
	  or run make in another clone.' >&2; exit 1)
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  printf 'error: this needs Python 3.10 or newer; "%s" is %s.\nName another: make %s PYTHON=python3.12\n' \
	    "$(PYTHON)" "$$("$(PYTHON)" --version 2>&1)" "$(MAKECMDGOALS)" >&2; exit 1; }
	@rm -rf .venv && mkdir .venv && echo unfinished > $@
	"$(PYTHON)" -m venv .venv
	@printf '%s\n' "$(CURDIR)" "$(PYTHON)" > $@

.venv/requirements: .venv/made $(REQUIREMENTS)
	$(PIP) install --quiet 'setuptools>=70.1,<80' '.[ros,live]'
	@touch $@

.venv/bench-requirements: .venv/requirements
	$(PIP) install --quiet '.[ros,mjcf,bench]'
	@touch $@

.venv/docs-requirements: .venv/requirements
	$(PIP) install --quiet '.[ros,mjcf,docs]'
	@touch $@

.venv/test-requirements: .venv/requirements
	$(PIP) install --quiet '.[ros,test]'
	@touch $@

# Not editable: `pip install -e` leaves out what `ros2 run` needs. build/ may hold removed modules.
.venv/package: .venv/requirements $(SOURCES)
	rm -rf build
	$(PIP) install --quiet --no-deps --no-build-isolation --force-reinstall .
	@rm -rf build
	@touch $@
