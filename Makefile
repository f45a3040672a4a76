# Two commands for a fresh machine with Python and nothing else: `make demo` and `make test`.
PYTHON ?= python3
RUN ?= runs/demo
MISSING ?= $(RUN)_missing
BIN := .venv/bin
INSTALLED := .venv/installed

.PHONY: demo test lint clean

# two scenes, each going on where it was stopped: an elastic bird, and a torus that falls under a hidden effect
demo: $(INSTALLED)
	@$(call fit,$(RUN),configs/demo.yaml)
	@$(call fit,$(MISSING),configs/demo_missing.yaml)
	@$(BIN)/pacnerf-lpo diagnose $(MISSING) --candidates configs/demo_candidates.yaml --particles 2500 --twins 8 --effects 1
	@echo "$(abspath $(RUN))/report.html"
	@echo "$(abspath $(MISSING))/diagnosis/diagnosis.html"

fit = if [ -f $(1)/manifest.json ]; then $(BIN)/pacnerf-lpo fit --resume $(1); else \
	$(BIN)/pacnerf-lpo fit --config configs/fit.yaml --config $(2) --outer_loop.run_dir $(1); fi

test: lint
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q --numprocesses 2

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

clean:
	rm -rf .venv runs

# the stamp is newer than what it was installed from, so an installation is not repeated
$(INSTALLED): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --constraint constraints.txt --editable '.[dev]'
	touch $@
