# make demo   the main job, done by real ROS 2 processes; pictures in demo_output/
# make test   the tests
# make bench  timings of the core
# make lint   style
# Each sets up what it needs in .venv (Python 3.11 or 3.12) and is quick the second time.

PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python
KERNELS := $(shell grep -rl 'from numba import' dlo_planner --include=*.py)

.PHONY: demo test bench lint clean
demo: $(VENV)/ready $(VENV)/kernels
	$(RUN) -m dlo_planner.ros.demo

test: $(VENV)/ready $(VENV)/kernels
	$(RUN) -m pytest -n 2

bench: $(VENV)/ready $(VENV)/kernels
	$(RUN) benchmarks/run.py

lint: $(VENV)/ready
	$(RUN) -m ruff check .

$(VENV)/ready: requirements.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 12) \
	  else f"Python 3.11 or 3.12 is needed, this is {v[0]}.{v[1]}: make PYTHON=python3.12 ...")'
	@echo 'Setting up $(VENV) (once; a few minutes) ...'
	@$(PYTHON) -m venv $(VENV) || { echo 'The venv module is missing: apt install python3-venv'; \
	  exit 1; }
	@$(RUN) -m pip install --quiet --disable-pip-version-check -r requirements.txt
	@touch $@

# numba's caches notice a change of their own file only, not of the kernels it calls.
$(VENV)/kernels: $(KERNELS) | $(VENV)/ready
	@find dlo_planner -name '*.nb[ic]' -delete
	@touch $@

clean:
	rm -rf $(VENV) demo_output build install log .pytest_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
