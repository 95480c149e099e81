# Everything runs from nothing: a Python >= 3.11 and make. `make help` lists the targets.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
TEST := $(VENV)/.test
# Compiled are only the modules that may run: 0.1 GB less.
INSTALL := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check
# Tests wait for the processes they start: one more at a time than there are cores.
SIDE_BY_SIDE = $$(( $$(getconf _NPROCESSORS_ONLN) + 1 ))
# Tests' rewritten assertions are kept, also where Python is told to write no bytecode.
unexport PYTHONDONTWRITEBYTECODE
TWINS ?= --tag quick
FUZZED ?= $(or $(TMPDIR),/tmp)/eos-ref-fuzzed
SOAK ?= 20000
SOAKED ?= $(or $(TMPDIR),/tmp)/eos-ref-soak
MACHINE ?= 200
MACHINED ?= $(or $(TMPDIR),/tmp)/eos-ref-binary
ANSWERING ?= env pypi:2025.7.22.1.0
FUZZ ?= --seconds 600 --seed 1
LOWEST := build/lowest
ENGINES ?= $(foreach v,0.1 0.2 1.0 2.0 4.0,pypi:2025.7.22.$(v))

, := ,
picture = chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --virtual-time-budget=8000 --blink-settings=preferredColorScheme=1 \
  --window-size=$(2) --screenshot=reports/$(1).png 'file://$(CURDIR)/reports/$(3)'

.PHONY: help setup validate campaign quick fast test lowest browser kills large soak environment slurm typed unittest workshop check bench claims docs versions engines power binary judge fuzz fuzz-nightly pictures clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  \1\t/' | expand -t 16

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version.split()[0]; sys.exit(sys.version_info < (3, 11) and f"eos-ref needs Python 3.11 or later, {sys.executable} is {v}: make PYTHON=...")'
	@echo 'setting up $(VENV): 0.3 GB to download, 1 GB on disk (a minute or two) ...'
	@$(PYTHON) -m venv $(VENV)
	$(INSTALL) -e '.[engine]'
	@$(BIN)/python -m compileall -q -j 0 -x '/(tests?|pip|setuptools|ase)/' $(VENV)/lib || true
	@touch $@

# What only the makers need, by the extra of pyproject.toml, is added to the same environment by the first target that needs it.
$(VENV)/.%: $(READY)
	@echo 'adding the packages of the extra $* ...'
	$(INSTALL) -e '.[$*]'
	@touch $@

setup: $(READY) ## create the environment in .venv and install what the commands need into it

validate: $(READY) ## set up, run the cases against real LAMMPS (eos-ref run --tag all: all 987), say where the report lies
	$(BIN)/eos-ref run
	@echo 'all reports: reports/index.html; the commands are in $(BIN): source $(BIN)/activate'

campaign: $(TEST) ## the report of `make validate`: every case as expected, scenes that tell formulas apart
	$(BIN)/python -m pytest -m campaign tests/lammps_cases/run

quick: $(READY) ## the cases that take a few seconds, against the accepted baseline
	$(BIN)/eos-ref run --tag quick --baseline reports/accepted

test: $(TEST) ## set up and run the tests
	$(BIN)/python -m pytest -n $(SIDE_BY_SIDE) --maxprocesses 4 --dist loadfile --no-loadscope-reorder --durations=15

fast: $(TEST) ## the tests that need neither LAMMPS nor patience
	$(BIN)/python -m pytest -n auto --maxprocesses 4 -m "not lammps and not slow"

lowest: ## the quick cases and the fast tests, each library in the lowest version of pyproject.toml, in build/lowest
	mkdir -p $(LOWEST)
	grep -oE '"[A-Za-z][A-Za-z0-9_-]*(\[[a-z]+\])?>=[0-9.]+' pyproject.toml | sed -E 's/"([^[>]+)(\[.*\])?>=/\1==/' > $(LOWEST)/versions.txt
	PIP_CONSTRAINT=$(CURDIR)/$(LOWEST)/versions.txt PYTEST_ADDOPTS='-W ignore::DeprecationWarning' $(MAKE) VENV=$(LOWEST) quick fast

browser: $(TEST) $(VENV)/.docs ## the tests that draw a report and the site in chromium
	$(BIN)/python -m pytest -m browser tests/lammps_cases/report tests/test_site.py

typed: $(TEST) ## every command of the documents, which must print the output shown (some minutes)
	$(BIN)/python -m pytest -n $(SIDE_BY_SIDE) --maxprocesses 4 -m typed tests/test_documents_typed.py

slurm: $(TEST) ## the tests of the kit for Slurm, on a Slurm started for them (needs slurmctld, slurmd, munge)
	$(BIN)/python -m pytest -m slurm tests/workshop

unittest: $(TEST) ## LAMMPS' own test programs on the kit for them; LAMMPS=TREE, with a serial build in its folder build
	EOS_REF_TREE='$(LAMMPS)' $(BIN)/python -m pytest -m unittest tests/lammps_cases/bugs/upstream

workshop: $(TEST) ## the tests of what only the makers run, tests/workshop (half an hour)
	$(BIN)/python -m pytest -m workshop tests/workshop

check: $(TEST) $(VENV)/.check ## lint, format, types, direction of imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

kills: $(TEST) ## kill runs at random moments and resume them, 300 times here, 100 on a Dask cluster (over an hour)
	$(BIN)/python -m pytest -s -m kills tests/workshop

large: $(TEST) ## a million particles, every one judged, on one rank, two and four, in 4 GB (some minutes); LARGE=large.million-3d, large.four-million
	$(BIN)/python -m tests.workshop.large $(LARGE)

soak: $(TEST) ## 20 000 cases in one campaign, here and through Dask (an hour); SOAK=2000 for fewer
	EOS_REF_SOAK='$(SOAK)' $(BIN)/python -m pytest -s -m soak tests/workshop --basetemp '$(SOAKED)'

environment: $(TEST) ## the tests of full disks, which need root
	$(BIN)/python -m pytest -m root tests/lammps_cases/run

bench: $(READY) ## speed against peers, in one run, as ratios
	$(BIN)/eos-ref bench

claims: $(READY) ## every statement of the manual: does it hold
	$(BIN)/eos-ref claims

docs: $(VENV)/.docs ## build the pages of docs/ as a site in reports/site, to read offline
	$(BIN)/mkdocs build --strict --quiet
	@echo 'reports/site/index.html'

versions: $(READY) ## every LAMMPS with RHEO against every other (some minutes)
	$(BIN)/eos-ref compare $(ENGINES) --tag all

engines: $(TEST) ## every LAMMPS with RHEO, or ENGINES='path:BUILD ...': baselines, decks of the findings (some minutes)
	@for engine in $(ENGINES); do echo "$$engine"; \
	  $(BIN)/eos-ref run --tag quick --engine "$$engine" --baseline reports/accepted --out reports/engines || exit; done
	EOS_REF_ENGINES='$(ENGINES)' $(BIN)/python -m pytest tests/lammps_cases/bugs

twins: $(READY) ## the same LAMMPS twice, memory filled with other bytes, TWINS='--tag quick' or other cases: the same bits
	for byte in 85 170; do MALLOC_PERTURB_=$$byte $(BIN)/eos-ref run $(TWINS) --out reports/twins/$$byte || exit; done
	OMP_NUM_THREADS=2 $(BIN)/eos-ref run $(TWINS) --out reports/twins/threads
	$(BIN)/eos-ref compare reports/twins/85 reports/twins/170 --strict --out reports/twins/memory
	$(BIN)/eos-ref compare reports/twins/85 reports/twins/threads --strict --out reports/twins/of-threads

power: $(TEST) ## plant faults, measure what goes unseen, look for false alarms (long); POWER='faults --quick-only'
	$(BIN)/python -m tests.workshop.power $(POWER)

binary: $(TEST) ## plant faults in LAMMPS' own machine code (x86-64), MACHINE='COUNT [ENGINE]' (a minute or more each)
	$(BIN)/python -m tests.workshop.machine_code '$(MACHINED)' $(MACHINE)

judge: $(TEST) $(VENV)/.judge ## mutate the code that judges; its tests, or answers of ANSWERING, have to notice (hours)
	$(BIN)/mutmut run --max-children 2
	$(BIN)/python -m tests.workshop.recorded_answers $(ANSWERING)
	$(BIN)/python -m tests.workshop.judge

fuzz: $(TEST) ## ten minutes of random scenes; FUZZ='--seconds 3600 --seed 2' for an hour of others
	$(BIN)/python -m tests.workshop.fuzz $(FUZZ)

fuzz-nightly: $(TEST) $(VENV)/.fuzz ## every reader of files under atheris, 1.4 million inputs (long; needs a Python that atheris has wheels for)
	$(BIN)/python -m tests.workshop.fuzz_nightly $(FUZZED) 3e5

pictures: $(READY) ## the pictures of flows, a report, a case and a comparison in the documents (needs chromium)
	$(BIN)/python -m tests.workshop.pictures
	$(BIN)/eos-ref run walls-moving thermal forces.all cross-type surfaces refused near-rho0 runs --out reports/pictures
	$(BIN)/eos-ref compare pypi:2025.7.22.1.0 pypi:2025.7.22.2.0 walls thermal forces.all refused --no-timing --fail-on new --out reports/versions
	$(call picture,report,1280$(,)1010,pictures/report.html)
	$(call picture,example,1280$(,)1475,pictures/report.html#case=walls-moving.driven.quintic)
	$(call picture,compare,1280$(,)820,versions/compare.html)

clean: ## remove the environment, caches and reports (not the accepted baselines)
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache mutants
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
	find reports -mindepth 1 -maxdepth 1 ! -name accepted ! -name '*.png' -exec rm -rf {} +
