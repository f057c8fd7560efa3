# Every target first installs the packages that it needs into .venv; later calls skip this step.
# ARGS is passed to the command of a target, e.g. make study ARGS="--realizations 5".

VENV  := .venv
BIN   := $(VENV)/bin
STAMP := $(shell date +%Y%m%d-%H%M%S)
ARGS  :=
export PYTHON

.PHONY: help study study-paper quick test lint docs figures bench matrix ci-full release-check clean

help:
	@echo "make study          run the paper's Beaufort Sea study at full size"
	@echo "make study-paper    run the studies of both regions of the paper, and compare them on one page"
	@echo "make quick          run a small study (half a minute the first time, then a few seconds)"
	@echo "make test           run the fast tests"
	@echo "make lint           check formatting, lint, types, import contracts and spelling"
	@echo "make docs           build the documentation site in build/docs"
	@echo "make figures        draw the figures of the documentation again (minutes); ARGS=all also draws the slow ones"
	@echo "make bench          measure computing times"
	@echo "make matrix         run the fast tests on each installed Python from 3.11 to 3.14, and with the oldest dependencies (needs uv)"
	@echo "make ci-full        run all checks: lint, site, slow tests, all pages and examples, kernels with bounds checked;"
	@echo "                    an interrupted run goes on where it stopped"
	@echo "make release-check  check version, changelog and archives; test the wheel on the oldest and newest installed Python"
	@echo "make clean          remove .venv, caches and builds, but not runs/"

study: $(VENV)/.ready-run
	$(BIN)/mantaray study run beaufort $(ARGS)

study-paper: $(VENV)/.ready-run
	$(BIN)/mantaray study run beaufort --format pdf,tex --out runs/paper-$(STAMP)/beaufort $(ARGS)
	$(BIN)/mantaray study run fram --format pdf,tex --out runs/paper-$(STAMP)/fram $(ARGS)
	$(BIN)/mantaray study compare --format pdf,tex runs/paper-$(STAMP)/beaufort runs/paper-$(STAMP)/fram \
	  --out runs/paper-$(STAMP)/comparison

quick: $(VENV)/.ready-run
	$(BIN)/mantaray study run quick $(ARGS)

# workers share one compilation of the kernels, see tests/conftest.py
test: $(VENV)/.ready-test
	$(BIN)/python -m pytest -n auto --dist worksteal $(ARGS)

lint: $(VENV)/.ready-lint
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell src tests docs examples benchmarks ros2 README.md CONTRIBUTING.md CHANGELOG.md Makefile

# warnings are errors; ARGS="-j 2" builds in two processes
docs: $(VENV)/.ready-docs
	rm -rf build/docs-source
	$(BIN)/python docs/site/stage.py build/docs-source
	$(BIN)/sphinx-build -q -W --keep-going -c docs/site $(ARGS) build/docs-source build/docs
	@echo "build/docs/index.html"

figures: $(VENV)/.ready-test
	$(BIN)/python benchmarks/gallery.py $(ARGS)

bench: $(VENV)/.ready-run
	$(BIN)/python benchmarks/all_rows.py $(ARGS)

UV_TEST := uv run --quiet --isolated --no-project --with-editable . --with "pytest>=9" --with "hypothesis>=6.115" --with "evo>=1.31" --with "pydap>=3.5.9" --with waitress --with "zarr>=3.1" --with h5py --with copernicusmarine

# The fast tests on Python $(1) in $(VENV)/matrix-$(2), with options $(3) of uv and $(4) of pytest. Each environment has its own
# cache of kernels, because versions of Numba overwrite each other's files.
define tested
@uv venv --quiet --clear --python $(1) $(VENV)/matrix-$(2) || { echo "matrix: Python $(1) is not installed, skipped"; exit 0; }; \
  uv pip install --quiet --python $(VENV)/matrix-$(2)/bin/python --editable . --group test $(3) && \
  NUMBA_CACHE_DIR=$(CURDIR)/$(VENV)/matrix-$(2)/kernels \
  $(VENV)/matrix-$(2)/bin/python -m pytest -n auto --dist worksteal $(4) $(ARGS)
endef

matrix:
	$(call tested,3.11,3.11)
	$(call tested,3.12,3.12)
	$(call tested,3.13,3.13)
	$(call tested,3.14,3.14)
	$(call tested,3.11,lowest,--resolution lowest-direct,-W ignore::DeprecationWarning)

# parts that have passed on the tree of this commit are not run again; ARGS="slow docs" runs some parts
ci-full: $(VENV)/.ready-lint $(VENV)/.ready-docs
	$(BIN)/python .ci/full.py $(ARGS)

# ARGS="--tests tests/records" runs fewer tests of the installed wheel; ARGS=--write writes docs/reference/dependencies.md
release-check: $(VENV)/.ready-release
	$(BIN)/python .ci/release_check.py $(ARGS)

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find src tests benchmarks examples ros2 -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.ready-run: pyproject.toml .ci/venv
	sh .ci/venv
	@touch $@

$(VENV)/.ready-test: pyproject.toml .ci/venv
	sh .ci/venv test
	@touch $@ $(VENV)/.ready-run

$(VENV)/.ready-docs: pyproject.toml .ci/venv
	sh .ci/venv docs
	@touch $@ $(VENV)/.ready-run

# types are checked against the packages that tests and extras use
$(VENV)/.ready-lint: pyproject.toml .ci/venv
	sh .ci/venv test lint
	@touch $@ $(VENV)/.ready-test $(VENV)/.ready-run

$(VENV)/.ready-release: pyproject.toml .ci/venv
	sh .ci/venv release
	@touch $@ $(VENV)/.ready-run
