# Two commands do everything, their set-up included: `make bench` and `make test`.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
OUT ?= runs/bench

# The grid that the regression gate watches: minutes, all five shipped cloths, solvers with and without chance in them.
# On the clamp of the shipped set's own truth, as its baseline.
GATE := --data synthetic --law plate --solver homo --solver nlopt:LN_BOBYQA --solver nlopt:GN_ESCH --solver null:disc \
  --solver null:random-phase,draws=50 --vertices 297 --steps 40 --budget 30 --seeds 2

.DEFAULT_GOAL := help
.PHONY: help bench test slow nightly audit check baseline lint types imports packaging docs picture readme clean

help:  ## This list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "%-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "cusick-bench needs Python 3.11 or newer; pass PYTHON=..."'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,docs,browser]'
	touch $(READY)

bench: $(READY)  ## The main job on the shipped synthetic set: fit, score, leaderboard, report
	$(BIN)/cusick-bench run --data synthetic --law plate --cloth fabric_1 --cloth fabric_3 --cloth fabric_5 \
	  --solver homo --solver nlopt:LN_BOBYQA --solver null:disc --solver null:copy --solver null:random-phase \
	  --vertices 600 --budget 30 --out $(OUT)
	$(BIN)/cusick-bench leaderboard $(OUT)
	$(BIN)/cusick-bench report $(OUT)

test: $(READY)  ## The default suite
	$(BIN)/python -m pytest -q -n 2 --dist worksteal -m "not slow and not nightly and not threads"
	$(BIN)/python -m pytest -q -m "threads and not slow and not nightly"

slow: $(READY)  ## Paper-size checks (minutes)
	$(BIN)/python -m pytest -q -n 2 --dist worksteal -m slow

nightly: $(READY)  ## Kills at random moments, fuzzed loaders (hours); CUSICK_MOMENTS and CUSICK_EXAMPLES say how many
	$(BIN)/python -m pytest -q -m nightly

check: $(READY)  ## The regression gate: have the solvers become worse than leaderboards/baseline.csv says?
	rm -rf runs/check  # finished cells would be taken as they are, whatever has changed in the code
	$(BIN)/cusick-bench run $(GATE) --workers 2 --out runs/check || test $$? -eq 1  # 1: a cell failed, which the check judges
	$(BIN)/cusick-bench check runs/check --against leaderboards/baseline.csv

baseline: $(READY)  ## Makes that baseline anew; commit it with the change that explains it
	rm -rf runs/check
	$(BIN)/cusick-bench run $(GATE) --workers 2 --out runs/check
	$(BIN)/cusick-bench check runs/check --against leaderboards/baseline.csv --write

lint: $(READY)  ## Faults and format of the code (ruff)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)  ## Types (pyright)
	$(BIN)/pyright

imports: $(READY)  ## The import contracts in pyproject.toml
	$(BIN)/lint-imports

packaging: $(READY)  ## Wheel, sdist, editable install and a clone without symbolic links, each run outside the checkout
	.ci/packaging $(BIN)/python

SCANNERS := build/scanners
audit: $(READY)  ## Known vulnerabilities of what is installed, and build/sbom.json, which lists it (CycloneDX)
	$(PYTHON) -m venv $(SCANNERS)
	$(SCANNERS)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt pip-audit cyclonedx-bom
	.ci/audit $(BIN)/python $(SCANNERS)/bin

docs: $(READY)  ## The documentation in build/docs; broken links fail
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

picture: $(READY)  ## docs/architecture.svg from the import contracts
	$(BIN)/python docs/architecture_picture.py

readme: $(READY)  ## The README's leaderboard from the results of `make bench`
	$(BIN)/python docs/readme_leaderboard.py $(OUT)

clean:  ## What make has made, apart from .venv; other results in runs/ stay
	rm -rf build dist *.egg-info runs/bench runs/check
	find . -name '__pycache__' -not -path './$(VENV)/*' -prune -exec rm -rf {} +
