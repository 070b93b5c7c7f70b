# Everything a fresh machine needs, without a screen: `make render`, `make test`; see README.md.
#
#   make setup       the project's own virtual environment with Blender as a Python module
#   make render      render blend_scenes/still_life.blend to build/still_life.png (SIZE=960x640 SAMPLES=64 for more)
#   make test        the tests of the quick tier;  make test-all: the slow ones too
#   make check       formatting, lint and types
#   make test-oldest      the add-on's quick tests in Blender 4.2.0, which it installs into build
#   make test-clusters    renders on a Dask cluster of this computer, and the job templates for render farms
#   make test-windows     the ray tracer's tests, all scenes and the command line on Windows' rules, under Wine
#   make test-processors  all scenes, and the certified tests, as other processors compute them
#   make report      speed against error beside other ray casters: tests/report, tables and plots (some minutes)
#   make extension   dist/reference_raytracer-VERSION.zip, to install in Blender
#
# PYTHON=... chooses the interpreter for the environment; it must be one that the bpy wheels exist for.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.PHONY: setup render test test-all test-oldest test-clusters test-windows test-processors check report extension clean

PYTHON ?=
SCENE := blend_scenes/still_life.blend
PICTURE := build/still_life.png
SIZE ?= 480x320
SAMPLES ?= 8
BIN := .venv/bin
READY := .venv/ready
REPORT_READY := .venv/report_ready
CLUSTERS_READY := .venv/clusters_ready
# Tests run in so many processes, each file in one of them; PROCESSES=0 runs them in one, as a debugger wants it.
PROCESSES ?= 2
SHARED_OUT = -n $(PROCESSES) --dist loadfile
# For instance BENCH_OPTIONS='--rays 100000 --rounds 7 --large'.
BENCH_OPTIONS ?=

setup: $(READY)

$(READY): pyproject.toml .ci/setup
	@PYTHON='$(PYTHON)' .ci/setup
	@touch $@

render: $(READY)
	@mkdir -p $(dir $(PICTURE))
	@$(BIN)/python -m addon render $(SCENE) -o $(PICTURE) --size $(SIZE) --samples $(SAMPLES)

test: $(READY)
	@$(BIN)/python -m pytest $(SHARED_OUT) -m 'not slow' tests

test-all: $(READY)
	@$(BIN)/python -m pytest $(SHARED_OUT) tests

$(CLUSTERS_READY): $(READY)
	@$(BIN)/python -m pip install -q --disable-pip-version-check -e '.[dask,farm]'
	@touch $@

test-clusters: $(CLUSTERS_READY)
	@$(BIN)/python -m pytest tests/raytracer/rendering/test_clusters.py tests/addon/farm

test-oldest: $(READY)
	@.ci/test_oldest

test-windows: $(READY)
	@.ci/test_windows

test-processors: $(READY)
	@.ci/test_processors

check: $(READY)
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/mypy

$(REPORT_READY): $(READY)
	@$(BIN)/python -m pip install -q --disable-pip-version-check -e '.[report]'
	@touch $@

report: $(REPORT_READY)
	@mkdir -p build
	@$(BIN)/python -m addon bench --json $(BENCH_OPTIONS) > build/bench.json
	@$(BIN)/python -m tests.benchmarks.report build/bench.json tests/report
	@$(BIN)/python -m tests.benchmarks.agreement tests/report
	@$(BIN)/python -m tests.benchmarks.passes tests/report
	@$(BIN)/python -m tests.digest.export build/digest
	@$(BIN)/python -m tests.benchmarks.error_pass build/digest tests/report/error_pass.png

extension: $(READY)
	@$(BIN)/python .ci/build_extension dist

clean:
	rm -rf build dist .venv
