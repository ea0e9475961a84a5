# SPDX-License-Identifier: Apache-2.0
# Everything runs in the virtual environment .venv in this folder, made on first use.
#   make demo ARGS='--duration 50'     make test ARGS='-k barrier'     make PYTHON=python3.12 test
#   make soak MINUTES=60

PYTHON ?= python3
ARGS ?=
MINUTES ?= 60
VENV := .venv
PY := $(VENV)/bin/python

# Where ROS 2 Jazzy is sourced, its rclpy and messages are used instead of the PyPI wheels.
ifeq ($(ROS_DISTRO),jazzy)
  ROS := $(shell $(PYTHON) -c 'import rclpy, sensor_msgs; print("sourced")' 2>/dev/null)
endif

ifeq ($(ROS),sourced)
  # ROS's messages are compiled against the system's numpy, so that one stays; pinocchio's
  # wheels need a newer numpy, so it comes from ros-jazzy-pinocchio.
  EXTRAS := fast,mujoco,plot,campaign,test,lint
  SIZE := 0.9 GB
  VENV_FLAGS := --system-site-packages
  PIP_FLAGS := --constraint $(VENV)/constraints.txt
  STAMP := $(VENV)/.made-on-sourced-ros
  ROS_NOTE := Using the sourced ROS 2 Jazzy instead of the PyPI wheels.
else
  EXTRAS := ros,urdf,fast,mujoco,plot,campaign,test,lint
  SIZE := 1.7 GB
  STAMP := $(VENV)/.made-on-pypi-ros
  # The wheels bring a whole ROS: keep another sourced ROS, or another environment, out of it.
  unexport AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH ROS_DISTRO
  unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
  export RMW_IMPLEMENTATION := rmw_fastrtps_cpp
  ifneq ($(AMENT_PREFIX_PATH),)
    unexport PYTHONPATH LD_LIBRARY_PATH
    ROS_NOTE := Using the PyPI wheels of ROS 2 Jazzy: the sourced ROS '$(ROS_DISTRO)' is not a Jazzy that $(PYTHON) can import.
  endif
endif

# Logs and caches stay in the folder as well.
export ROS_LOG_DIR := $(CURDIR)/$(VENV)/log
export MPLCONFIGDIR := $(CURDIR)/$(VENV)/cache/matplotlib
unexport PYTHONHOME
# Without it every process of a test or a demo would compile the whole package again.
unexport PYTHONDONTWRITEBYTECODE

define CHECK_PYTHON
import sys
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    sys.exit("make: %s is Python %s: expected 3.10 to 3.13, try make PYTHON=python3.12"
             % (sys.executable, sys.version.split()[0]))
endef
export CHECK_PYTHON

.DELETE_ON_ERROR:
.PHONY: help env demo test test-plain mutants bench soak attack lint clean

help:  ## print this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

env: $(STAMP)  ## make .venv with every dependency
	@$(if $(ROS_NOTE),echo "$(ROS_NOTE)",:)

demo: env  ## run the paper's two-link task in four processes; ARGS go to the demo
	@$(PY) -m adaptive_blf_control demo $(ARGS)

# First what computes, two at a time; then, beside nothing that does, what moves a simulated robot in
# real time, three files at a time: it mostly waits.
# pytest's status 5 means that ARGS selected nothing there: an error where that is so in both.
test: env  ## run all tests; ARGS go to pytest
	@export ROS_PYTHON_CHECK_FIELDS=1 first=0 second=0; \
	$(PY) -m pytest -n 2 -m 'not real_time' $(ARGS) || first=$$?; \
	$(PY) -m pytest -n 3 --dist loadfile -m real_time $(ARGS) || second=$$?; \
	case $$first-$$second in 0-0 | 0-5 | 5-0) ;; *) exit 1 ;; esac

# The rooms in which numba compiles; what takes minutes then is left out. The nodes may be asked for:
# make test-plain PLAIN=test/nodes
PLAIN ?= test/arms test/control test/identification test/limits test/simulation
test-plain: env  ## test the laws as plain numpy, without numba; ARGS go to pytest
	@NUMBA_DISABLE_JIT=1 $(PY) -m pytest -n 2 -m 'not slow_plain' $(PLAIN) $(ARGS)

mutants: env  ## break each law on purpose: which tests notice? ARGS: words of some mutants
	@$(PY) test/mutation/run_mutants.py $(ARGS)

bench: env  ## measure the figures of docs/benchmarks.md; ARGS go to the benchmark
	@$(PY) -m adaptive_blf_control bench $(ARGS)

soak: env  ## run the four processes for MINUTES=60: memory, latency, account of messages
	@$(PY) -m adaptive_blf_control soak --minutes $(MINUTES) $(ARGS)

attack: env  ## let strangers attack the four processes for MINUTES=10 under an observer
	@$(PY) -m adaptive_blf_control attack --minutes $(if $(filter file,$(origin MINUTES)),10,$(MINUTES)) $(ARGS)

lint: env  ## ruff and mypy over the package
	@$(PY) -m ruff check .
	@$(PY) -m mypy adaptive_blf_control

clean:  ## remove .venv and everything that was built, not your bags
	rm -rf $(VENV) build dist install log *.egg-info
	rm -rf .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find adaptive_blf_control launch test -name __pycache__ -prune -exec rm -rf {} +

$(STAMP): setup.py setup.cfg
	@command -v $(PYTHON) >/dev/null || { echo "make: no $(PYTHON) found: expected Python 3.10 to 3.13, try make PYTHON=/path/to/python3" >&2; exit 1; }
	@$(PYTHON) -c "$$CHECK_PYTHON"
	@echo "Making $(VENV) with $$($(PYTHON) --version): about $(SIZE), about five minutes."
	@$(PYTHON) -m venv --clear $(VENV_FLAGS) $(VENV)
	@$(if $(ROS),$(PYTHON) -c 'import numpy; print("numpy==" + numpy.__version__)' > $(VENV)/constraints.txt)
	@# Python 3.10 brings pip 23.0, which had not found versions after ten minutes.
	@$(PY) -m pip install --quiet --disable-pip-version-check 'pip>=23.1'
	@$(PY) -m pip install --quiet --disable-pip-version-check --prefer-binary --use-pep517 $(PIP_FLAGS) --editable '.[$(EXTRAS)]'
	@$(if $(ROS),$(PY) -c 'import pinocchio' 2>/dev/null || echo "No pinocchio: arms from a URDF need ros-jazzy-pinocchio from apt.")
	@mkdir -p "$(ROS_LOG_DIR)" "$(MPLCONFIGDIR)"
	@$(PY) -m adaptive_blf_control precompile
	@touch $@
