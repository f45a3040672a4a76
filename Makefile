# Two commands for a fresh machine with Python and nothing else: `make demo` and `make test`.
PYTHON ?= python3
RUN ?= runs/demo
BIN := .venv/bin
INSTALLED := .venv/installed

.PHONY: demo test lint clean

demo: $(INSTALLED)
	@if [ -f $(RUN)/manifest.json ]; then \
		$(BIN)/pacnerf-lpo fit --resume $(RUN); \
	else \
		$(BIN)/pacnerf-lpo fit --config configs/fit.yaml --config configs/demo.yaml --outer_loop.run_dir $(RUN); \
	fi
	@echo "$(abspath $(RUN))/report.html"

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
