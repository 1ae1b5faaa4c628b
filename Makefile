# make demo   the main job, done by real ROS 2 processes; pictures in demo_output/
# make test   checks and tests, some minutes: all that guards safety and right answers; before a commit
# make test-all  in addition: sweeps over cases, wheel and sdist, kernel caches, site; an hour
# make bench  timings beside a hand-written loop, peers, the paper's figures: docs/benchmarks.md
# make figures  all figures of the paper, a few minutes; figures_output/ (docs/reproduction.md)
# make validation  what the pages of validations say, measured again; below ten minutes
# make bench-check  fails where a ratio to that loop has grown by 30 %
# make cell   20 tasks in a physics engine; runs and a film in cell_output/
# make soak   a node under odd messages, load and faults for 10 minutes; report in soak_output/
# make oldest  tests of the core, installed beside the oldest versions that setup.py allows
# make newest  the same with today's versions; PYTHON=python3.13 says for which Python
# make docs   the site: build/docs/index.html; warnings are errors
# make check  lint, types, import rules and rules of the sources: a minute, while you work
# make lint   style
# make types  annotations, by mypy
# make imports  imports go down the layers, the core knows no ROS
# make lock   newest versions that requirements-dev.txt allows, into requirements.lock
# Each sets up what it needs in .venv (Python 3.11 or 3.12) and is quick the second time.

PYTHON ?= python3
VENV := .venv
# the matrices are small: more threads wait for each other, above all on a busy machine
export OPENBLAS_NUM_THREADS ?= 1
# each of the many processes that tests start would compile the sources once more
unexport PYTHONDONTWRITEBYTECODE
CORE := $(addprefix test/,model geometry energy minimize direct plan trajectory inverse verify identify settings)
RUN := $(VENV)/bin/python
READY := $(VENV)/ready $(VENV)/compiled
KERNELS := $(shell grep -rl --include=*.py 'dlo_planner.kernels' dlo_planner)

.PHONY: demo test test-all computed real-time oldest newest bench figures validation bench-check cell soak docs check lint types imports lock clean
demo: $(VENV)/compiled
	$(RUN) -m demo

# What computes runs at once, and prints when it has ended; what runs in real time has the machine
# for itself.
QUICK := and not sweep
test: $(READY)
	@$(MAKE) --no-print-directory --jobs --output-sync=target QUICK='$(QUICK)' \
	  lint types imports computed
	@$(MAKE) --no-print-directory QUICK='$(QUICK)' real-time

test-all: QUICK :=
test-all: test

computed:
	$(RUN) -m pytest -n 2 --dist worksteal -m 'not real_time $(QUICK)'

real-time:
	$(RUN) -m pytest -n 2 --dist loadgroup --no-loadscope-reorder -m 'real_time $(QUICK)' \
	  -rR --reruns 1 --reruns-delay 5 --max-suite-reruns 5 test/ros test/view

oldest:
	$(PYTHON) -m venv build/oldest
	build/oldest/bin/python -m pip install --quiet --disable-pip-version-check -c .ci/oldest.txt \
	  '.[figures,cell,view,cluster,mesh]' pytest hypothesis
	build/oldest/bin/pytest -m 'not real_time $(QUICK)' $(CORE) test/cell/test_plant.py test/view

newest:
	$(PYTHON) -m venv build/newest
	build/newest/bin/python -m pip install --quiet --disable-pip-version-check \
	  '.[figures,cell,arm,view,cluster]' pytest hypothesis
	build/newest/bin/pytest -m 'not real_time $(QUICK)' $(CORE) test/cell/test_plant.py test/view

bench: $(READY) $(VENV)/peers
	$(RUN) -m benchmarks

figures: $(READY)
	$(RUN) -m benchmarks.figures

validation: $(READY)
	$(RUN) -m benchmarks.validation

bench-check: $(READY)
	$(RUN) -m benchmarks check

cell: $(READY)
	$(RUN) -m benchmarks.cell

soak: $(READY)
	$(RUN) test/soak --minutes 10 --output soak_output

docs: $(VENV)/ready
	$(RUN) -m sphinx -W --keep-going -q -E -a -b html docs build/docs

check: lint types imports
	$(RUN) -m pytest -q --no-header test/test_structure.py

lint: $(VENV)/ready
	$(RUN) -m ruff check .
	$(RUN) .ci/files.py

types: $(VENV)/ready
	$(RUN) -m mypy dlo_planner msg_helpers test/annotations/user.py

imports: $(VENV)/ready
	$(VENV)/bin/lint-imports --no-cache

# What the demo runs. Modules are compiled when they are imported: pip would take a minute for all.
PIP := $(RUN) -m pip install --quiet --disable-pip-version-check --no-compile
$(VENV)/runs: requirements.lock requirements.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 12) \
	  else f"Python 3.11 or 3.12 is needed, this is {v[0]}.{v[1]}: make PYTHON=python3.12 ...")'
	@echo 'Setting up $(VENV) (once; a minute or two) ...'
	@$(PYTHON) -m venv $(VENV) || { echo 'The venv module is missing: apt install python3-venv'; \
	  exit 1; }
	@$(PIP) -c requirements.lock -r requirements.txt
	@touch $@

$(VENV)/ready: $(VENV)/runs
	@echo 'Adding what tests and documentation need (once; a few minutes) ...'
	@$(PIP) -r requirements.lock
	@touch $@

# The kernels that have changed are compiled once, not by each process that needs them.
$(VENV)/compiled: $(VENV)/runs $(KERNELS)
	-@$(RUN) -m dlo_planner.prebuild && touch $@

# Peers that nothing else needs; without a network the benchmark goes on without them.
$(VENV)/peers: $(VENV)/ready
	-@$(PIP) -c requirements.lock pyelastica cosseratbench && touch $@

lock:
	rm -rf build/lock
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --disable-pip-version-check -r requirements-dev.txt
	build/lock/bin/python .ci/pins.py > requirements.lock

clean:
	rm -rf $(VENV) demo_output figures_output cell_output soak_output docs/made build install log \
	  .pytest_cache .hypothesis dlo_planner/compiled
	find . -name __pycache__ -prune -exec rm -rf {} +
