# Two commands for a fresh machine with Python and nothing else: `make demo` and `make test`.
PYTHON ?= python3
RUN ?= runs/demo
MISSING ?= $(RUN)_missing
BIN := .venv/bin
# what runs, and what runs and tests
READY := .venv/ready
INSTALLED := .venv/installed
THREADS := OMP_NUM_THREADS=$(shell expr \( $$(getconf _NPROCESSORS_ONLN) + 1 \) / 2)
JOBS := $(shell n=$$(getconf _NPROCESSORS_ONLN); echo $$((n < 8 ? n : 8)))

.PHONY: demo bird torus test quick coverage lint docs clean

# two scenes at the same time, each going on where it was stopped: an elastic bird, whose progress is shown, and a torus
# that falls under a hidden effect, whose progress is kept in a file
demo: $(READY)
	@mkdir -p $(dir $(MISSING))
	@$(MAKE) --no-print-directory --jobs 2 bird torus
	@tail -n 4 $(MISSING).log
	@echo "$(abspath $(RUN))/report.html"
	@echo "$(abspath $(MISSING))/diagnosis/diagnosis.html"
	@echo "change it by hand and watch the error fall: $(BIN)/pacnerf-lpo explore $(MISSING)"

bird: $(READY)
	@$(call fit,$(RUN),configs/demo.yaml)
	@echo "The second scene is not far behind; its progress: $(MISSING).log"

torus: $(READY)
	@{ $(call fit,$(MISSING),configs/demo_missing.yaml) && $(THREADS) $(BIN)/pacnerf-lpo diagnose $(MISSING) \
		--candidates configs/demo_candidates.yaml --particles 2500 --replicates 8 --effects 1 --jobs $(JOBS); } > $(MISSING).log 2>&1 \
		|| { tail -n 20 $(MISSING).log; exit 1; }

fit = if [ -f $(1)/manifest.json ]; then $(THREADS) $(BIN)/pacnerf-lpo fit --resume $(1); else \
	$(THREADS) $(BIN)/pacnerf-lpo fit --config configs/fit.yaml --config $(2) --outer_loop.run_dir $(1); fi

# fixtures of a module are made by one process, and whoever is done first takes over tests of the other
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q --numprocesses 2 --dist worksteal

test: lint
	$(PYTEST)

# what to run at every change
quick: $(INSTALLED)
	$(PYTEST) -m "not slow and not end_to_end"

coverage: $(INSTALLED)
	$(PYTEST) --cov --cov-report term:skip-covered --cov-report html:build/coverage
	@echo "$(abspath build/coverage/index.html)"

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	MYPY_NUM_WORKERS=$(JOBS) $(BIN)/mypy
	$(BIN)/lint-imports

docs: $(INSTALLED)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "$(abspath build/site)/index.html"

clean:
	rm -rf .venv build runs

# a stamp is newer than what it was installed from, so an installation is not repeated; pip compiles modules on one core
define install
test -x $(BIN)/python || $(PYTHON) -m venv .venv
$(BIN)/python -m pip install --no-compile --constraint constraints.txt --editable '.[$(1)]'
$(BIN)/python -m compileall -qq -j 0 .venv/lib || true # templates among them are no modules
endef

$(READY): pyproject.toml setup.py constraints.txt
	$(call install,explore)
	touch $@

$(INSTALLED): pyproject.toml setup.py constraints.txt
	$(call install,dev)
	touch $(READY) $@
