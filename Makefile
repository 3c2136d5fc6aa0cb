# Every target sets up what it needs first; a second run is quick. `make demo` and `make test` are the two to know.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
SHELL := /bin/sh
BIN := .venv/bin
PIP := $(BIN)/pip --disable-pip-version-check --quiet install --no-compile
# What is pinned. uv takes a fifth of pip's time; pip does it where uv does not come, or finds no index that pip knows.
PINNED = VIRTUAL_ENV=.venv UV_HTTP_TIMEOUT=10 UV_HTTP_RETRIES=0 $(BIN)/uv --quiet pip install --require-hashes -r $(1) 2>.venv/uv-said || \
	$(PIP) --require-hashes -r $(1)
PAGES := src/phalanx/gateway/pages
PEER := tests/peers/npm_qrkey
# Not what `make -C firmware check` writes: a later target would set everything up again.
FIRMWARE := $(filter-out firmware/build/%,$(wildcard setup.py firmware/build.py firmware/*/*.[ch] firmware/*/*/*.[ch]))
WEB_SOURCES := $(shell find web -type f -not -path '*/node_modules/*' 2>/dev/null)
# What kernels may be compiled from; a folder changes when a file in it is deleted.
KERNELS := $(shell find phalanx_compiler src/phalanx -name __pycache__ -prune -o -name pages -prune -o \( -type d -o -name '*.py' -o -name '*.[ch]' \) -print)
TESTS := $(wildcard tests/*.py tests/*/*.py tests/*/*/*.py)
# To read all other files takes longer than some of these tests.
marked = $(shell grep -ls 'mark\.$(1)\b' tests/test_*.py tests/*/test_*.py)
# Where everything waits: to read these files takes whoever computes a second.
ALL_WAIT := $(shell grep -lsE '^pytestmark = .*mark\.waits\b' tests/test_*.py tests/*/test_*.py)
# What only computes has what is left of the processor by those that wait for somebody, and have limits for it.
LEFT_OVER := chrt --idle 0
# A process per processor: each collects all tests, and sets up for itself what the tests of a file share.
COMPUTES := -m "not waits and not alone and not long" $(ALL_WAIT:%=--ignore=%) --numprocesses $(shell nproc) --dist worksteal
# Browsers take longest, though their files have few tests: begun last, one of them would go on alone.
BROWSERS := $(call marked,browser)
WAITS := -m "waits and not alone and not long" $(BROWSERS) $(filter-out $(BROWSERS),$(call marked,waits)) \
	--numprocesses 3 --dist loadfile --no-loadscope-reorder
# Two of them beside each other have a core each: what has idle time gives it back at once.
ALONE := -m "alone and not long" $(call marked,alone) --numprocesses 2 --dist worksteal
DEMO ?=
RELEASE ?=
# Tests start hundreds of processes, each of which would compile our modules again.
unexport PYTHONDONTWRITEBYTECODE
# Several targets at a time; what each says comes in one piece when it ends.
TOGETHER := $(MAKE) --no-print-directory --keep-going --output-sync=target --jobs

# What the system must have, asked for once and all at once; the tests need more than the demo.
NEEDED := .venv/needs
NEEDS := venv=python3-venv gcc=gcc libc=libc6-dev headers=python3-dev node=nodejs npm=npm
ifneq ($(filter test% check-long coverage lint% bench docs %-dev,$(MAKECMDGOALS)),)
NEEDED := .venv/needs-dev
NEEDS += mosquitto=mosquitto browser=chromium-headless-shell valgrind=valgrind spin=spin
# What stands before a gateway: 20 MB to fetch.
NEEDS += caddy=caddy nginx=nginx-light sshd=openssh-server ssh=openssh-client
# The only compiler with a fuzzer: 50 MB to fetch.
NEEDS += clang=clang fuzzer=libclang-rt-14-dev
# What the firmware is compiled with for microcontrollers: 70 MB to fetch.
NEEDS += arm-none-eabi-gcc=gcc-arm-none-eabi mipsel-linux-gnu-gcc=gcc-mipsel-linux-gnu
endif

.PHONY: help setup setup-dev ready ready-dev tools-dev demo test lint lint-python lint-web test-firmware test-web test-python \
	test-computes test-waits test-alone \
	test-waits-alone check-long coverage bench docs release clean

help:
	@echo "make demo    run a swarm, and drive it from a phone"
	@echo "make test    everything: lint, types, firmware, Python, TypeScript, browser, docs"
	@echo "make setup | lint | test-python | check-long | coverage | bench | docs | release | clean"

# --- setting up -------------------------------------------------------------------------------------------------------

setup:
	@$(MAKE) --no-print-directory --jobs=8 ready

setup-dev:
	@$(MAKE) --no-print-directory --jobs=8 ready-dev

ready: $(NEEDED) .venv/kernels $(PAGES)/built
tools-dev: $(NEEDED) .venv/kernels .venv/dev $(PAGES)/built $(PEER)/dist/peer.cjs
ready-dev: ready tools-dev .venv/needs-boards
ready ready-dev tools-dev:
	@: # make would say of each that there is nothing to be done

# Emulators, 170 MB that the boards' tests alone need: they come while others are busy.
.venv/needs-boards: | $(NEEDED) .venv/uv
	@scripts/need.sh qemu-system-arm=qemu-system-arm qemu-system-mipsel=qemu-system-mips
	@touch $@

$(NEEDED):
	@scripts/need.sh $(NEEDS)
	@mkdir -p .venv
	@touch $@

# pip comes last when a venv is made: one that was interrupted is made again.
.venv/bin/pip: | $(NEEDED)
	python3 -m venv .venv

.venv/uv: requirements-uv.lock | .venv/bin/pip
	@$(PIP) --require-hashes -r $< || echo "pip goes on without it"
	@touch $@

.venv/packages: requirements.lock | .venv/uv
	@echo "installing Python packages"
	@$(call PINNED,requirements.lock)
	@touch $@

.venv/runtime: .venv/packages pyproject.toml $(FIRMWARE)
	@echo "compiling the trusted nodes and the kernels"
	@$(PIP) --no-deps --no-build-isolation -e .
	@touch $@

# Most changes are none of a kernel.
.venv/kernels: .venv/runtime $(KERNELS)
	@PHALANX_PURE= $(BIN)/python -m phalanx_compiler.fresh 2>/dev/null || \
		{ echo "compiling the kernels"; $(BIN)/python setup.py --quiet build_ext --inplace; }
	@touch $@

# While compilers run: both lock files name the same versions (scripts/lock.sh), so that nothing they use is replaced.
.venv/dev: requirements-dev.lock .venv/packages
	@echo "installing Python packages for the tests"
	@$(call PINNED,requirements-dev.lock)
	@touch $@

.venv/coverage: requirements-coverage.lock .venv/dev
	@$(call PINNED,requirements-coverage.lock)
	@touch $@

# Not with the others: 180 MB that nobody needs but tests of make check-long.
.venv/ros2: requirements-ros2.lock .venv/dev
	@$(call PINNED,requirements-ros2.lock)
	@touch $@

# Nor what builds and runs the wheel for another processor.
.venv/zig: requirements-zig.lock .venv/dev
	@scripts/need.sh qemu-aarch64=qemu-user
	@$(call PINNED,requirements-zig.lock)
	@touch $@

web/node_modules/.installed: web/package-lock.json | $(NEEDED)
	@echo "installing npm packages for the pages"
	@cd web && npm ci --no-audit --no-fund --loglevel=error
	@touch $@

$(PAGES)/built: web/node_modules/.installed $(WEB_SOURCES)
	@echo "building the pages"
	@cd web && npm run --silent build
	@touch $@

$(PEER)/dist/peer.cjs: $(PEER)/package-lock.json $(wildcard $(PEER)/*.js $(PEER)/*.jsx) | $(NEEDED)
	@echo "installing the published npm client, for the tests"
	@cd $(PEER) && npm ci --no-audit --no-fund --loglevel=error && npm run --silent build

# --- doing ------------------------------------------------------------------------------------------------------------

demo: setup
	@$(BIN)/phalanx up --host 0.0.0.0 $(DEMO)

test:
	@$(TOGETHER)=10 test-waits-alone test-computes lint docs test-firmware test-web

lint: lint-python lint-web

# While kernels are compiled and npm installs: neither reads what is built.
lint-python: .venv/dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	PYTHONPATH=src:. $(BIN)/lint-imports --no-cache
	$(BIN)/python scripts/lint_docs.py
	$(LEFT_OVER) $(BIN)/mypy

# While pip installs.
lint-web: web/node_modules/.installed
	cd web && $(LEFT_OVER) npm run --silent lint
	cd web && $(LEFT_OVER) npm run --silent types

test-web: tools-dev
	cd web && $(LEFT_OVER) npm run --silent test

# As early: boards in QEMU are tested elsewhere.
test-firmware: .venv/dev
	$(LEFT_OVER) $(MAKE) --no-print-directory -C firmware check

test-python: setup-dev
	@$(TOGETHER)=2 test-computes test-waits-alone

# pytest compiles each file of tests, for its messages; five processes would do that at the same time. Tests that wait
# take longest, so that their files come first.
collected = $(BIN)/python -m pytest --collect-only -q $(1) >$@-said || { tail -40 $@-said; false; }
.venv/tests-that-wait: .venv/dev .venv/kernels $(TESTS)
	@$(call collected,$(call marked,waits))
	@touch $@

.venv/tests: .venv/tests-that-wait
	@$(call collected,$(ALL_WAIT:%=--ignore=%))
	@touch $@

test-computes: ready-dev .venv/tests
	$(LEFT_OVER) $(BIN)/python -m pytest --durations=10 $(COMPUTES)

# These have limits in real time, which a loaded machine may miss once: what fails runs a second time, one test at a
# time, and fails if that fails too. Both outputs stay.
timed = $(BIN)/python -m pytest -o cache_dir=.venv/$@ --durations=10 $(1) || \
	$(BIN)/python -m pytest -o cache_dir=.venv/$@ --last-failed --last-failed-no-failures=none $(1) --numprocesses 0

test-waits: ready-dev .venv/tests-that-wait
	$(call timed,$(WAITS))

test-alone: setup-dev
	$(call timed,$(ALONE))

test-waits-alone: test-waits
	@$(MAKE) --no-print-directory test-alone

check-long: setup-dev .venv/ros2 .venv/zig
	cd web && npm run --silent lint:long
	$(BIN)/python -m pytest --durations=10 -m long

coverage: setup-dev .venv/coverage
	rm -f .coverage .coverage.*
	$(BIN)/coverage run -m pytest $(COMPUTES)
	$(BIN)/coverage run -m pytest $(WAITS)
	$(BIN)/coverage run -m pytest $(ALONE)
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

bench: setup-dev
	$(BIN)/python benchmarks/bench_bti.py
	$(BIN)/python benchmarks/bench_radio.py
	$(BIN)/python benchmarks/bench_seeking.py
	$(BIN)/python benchmarks/bench_link.py
	$(BIN)/python benchmarks/bench_wheels.py
	$(BIN)/python benchmarks/bench_first_paint.py
	$(BIN)/python benchmarks/bench_thousand.py
	$(BIN)/python benchmarks/bench_attacks.py
	$(BIN)/python benchmarks/bench_sweep.py
	$(BIN)/python benchmarks/bench_mission.py
	$(BIN)/python benchmarks/bench_scan.py
	$(BIN)/python benchmarks/bench_mission_run.py
	$(BIN)/python scripts/mission_completion.py

docs: tools-dev
	NO_MKDOCS_2_WARNING=1 $(LEFT_OVER) $(BIN)/mkdocs build --strict --quiet --site-dir site

# All but the upload, of what is committed: CONTRIBUTING.md says what it looks at.
release: $(NEEDED) .venv/release/installed
	.venv/release/bin/python release/dry_run.py $(RELEASE)

.venv/release/installed: requirements-release.lock | .venv/bin/pip
	@.venv/bin/python -m venv .venv/release
	@.venv/release/bin/pip --disable-pip-version-check --quiet install --require-hashes -r requirements-release.lock
	@touch $@

clean:
	rm -rf build firmware/build src/*.egg-info src/phalanx/*.so src/phalanx/trusted_node
	rm -rf .venv site out .coverage .coverage.* .pytest_cache .mypy_cache .ruff_cache .hypothesis $(PAGES)
	rm -rf web/node_modules $(PEER)/node_modules $(PEER)/dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
