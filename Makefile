# PA Console. `make console` from a fresh clone opens it; a second `make` starts at once.
# Everything that is installed goes into .venv, models go into the user's cache folder.

PYTHON ?= python3
ARGS ?=

SHELL := bash
VENV := .venv
BIN := $(VENV)/bin
PIP := PYTHONUNBUFFERED=1 PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip
LLAMA := $(shell sed -n 's/^ *"\(llama-cpp-python==[^"]*\)".*/\1/p' pyproject.toml)
TEST_MODEL := smollm2-135m
# What reads unclear orders again is fetched with the model; `make console READER=` leaves it out.
READER ?= --with-second-reader
PINS := .constraints.txt
WHEELS := $(VENV)/wheels
# Make would take a target with an equals sign for a variable.
LLAMA_WHEEL := $(WHEELS)/.$(subst ==,-,$(LLAMA))
SITE := build/site
SBOM := build/sbom.json

# Keeps pip's whole output in the log $(1) and shows only how far it is: on a terminal in one
# line that is written over, elsewhere every 20th compiled file. Shows the end of the log when
# pip fails.
define calmly
2>&1 | tee $(1) | { \
	while IFS= read -r line; do \
		if [[ $$line =~ ^\ *\[([0-9]+)/([0-9]+)\] ]]; then \
			if [ -t 1 ]; then printf '\r\033[K  compiled %d of %d files' "$${BASH_REMATCH[@]:1:2}"; \
			elif (( BASH_REMATCH[1] % 20 == 0 )); then \
				printf '  compiled %d of %d files\n' "$${BASH_REMATCH[@]:1:2}"; fi; \
		elif [ -t 1 ] && [[ $$line =~ ^\ *(Collecting|Building|Installing)\ ([^\ ]+) ]]; then \
			printf '\r\033[K  %s %.60s' "$${BASH_REMATCH[1]}" "$${BASH_REMATCH[2]}"; \
		fi; \
	done; \
	if [ -t 1 ]; then printf '\r\033[K'; fi; } \
|| { tail -n 25 $(1); echo; echo "The installation failed; the whole output is in $(1)."
endef

# Prints the sections $(1) of the pinned libraries.
sections = awk -v wanted=' $(1) ' '/^\# /{on = index(wanted, " " $$2 " ")} on' $(PINS)

.DEFAULT_GOAL := help
.PHONY: help console test core check bench train lint site audit clean

help:
	@echo "make console   open the console (the first time installs it and fetches the model)"
	@echo "make test      run the tests            ARGS=... is passed on to pytest"
	@echo "make core      test the core with no plugin installed   VENV=build/core beside what .venv has"
	@echo "make check     check style, types and contracts, test what changed and the safety invariants (2 minutes)"
	@echo "make bench     measure this machine     ARGS=... which benchmark, and its options (ARGS=--help)"
	@echo "make train     make data, train adapters   ARGS=... which verb, and its options (ARGS=--help)"
	@echo "make lint      check style, formatting, types and import contracts (of the trainer, where torch is)"
	@echo "make site      render the manual as a static site, in $(SITE)"
	@echo "make audit     write the parts list (SBOM) in $(SBOM), look for known weaknesses"
	@echo "make clean     remove .venv and everything generated; fetched models stay"
	@echo
	@echo "READER=        leaves out the model that reads unclear orders again (491 MB)"
	@echo "PYTHON=...     the Python to install with, 3.11 or newer (now: $(PYTHON))"

console: $(VENV)/.installed-base
	@$(BIN)/pa-console models pull $(READER)
	@$(BIN)/pa-console

# The core's tests are those that need no extra: tests/conftest.py leaves out what is not installed.
test core: %: $(VENV)/.installed-%
	@$(BIN)/pa-console models pull $(TEST_MODEL)
	@$(BIN)/pytest --numprocesses auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder $(ARGS)

check: $(VENV)/.installed-dev
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --check --quiet .
	@$(BIN)/lint-imports --no-logo | tail -n 1
	@$(BIN)/python -m tests.check --numprocesses auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder $(ARGS)

bench: $(VENV)/.installed-test
	@$(BIN)/python -m tests.benchmarks $(ARGS)

train: $(VENV)/.installed-train
	@PYTHONPATH=models/training $(BIN)/python -m pa_training $(ARGS)

lint: $(VENV)/.installed-dev
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/pyright
	@! $(BIN)/python -c "import torch, transformers, peft" 2>/dev/null || $(BIN)/pyright --project models/training/pyrightconfig.json
	@$(BIN)/lint-imports --no-logo

site: $(VENV)/.installed-site
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict --config-file .mkdocs.yml
	@echo "$(SITE)/index.html"

audit: $(VENV)/.installed-audit
	@mkdir -p $(dir $(SBOM))
	@$(call sections,console) > $(VENV)/console-pins.txt
	@$(BIN)/cyclonedx-py requirements --pyproject pyproject.toml --output-reproducible \
		--output-file $(SBOM) $(VENV)/console-pins.txt
	@echo "$(SBOM)"
	@$(BIN)/pip-audit --require-hashes --disable-pip --progress-spinner off \
		--requirement $(VENV)/console-pins.txt

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find pa_console tests models -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@command -v "$(PYTHON)" >/dev/null || { \
		echo "There is no '$(PYTHON)' here: install Python 3.11 or newer, or name it: make PYTHON=python3.12 ..."; \
		exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "PA Console needs Python 3.11 or newer, and '$(PYTHON)' is $$("$(PYTHON)" -V 2>&1): name another one: make PYTHON=python3.12 ..."; \
		exit 1; }
	@echo "Creating $(VENV) with $$("$(PYTHON)" -V)"
	@"$(PYTHON)" -m venv $(VENV) || { \
		rm -rf $(VENV); \
		echo "The virtual environment could not be created; on Debian and Ubuntu: apt install python3-venv"; \
		exit 1; }

# llama.cpp's own switches leave out the vision library and nothing else. Half of what is still
# compiled is its `common` library, which the package forces on and does not install; a CMake
# file that is included after llama.cpp's `project()` switches it off again, and AMX too. No index
# has a wheel that was built so: it is always compiled here.
$(LLAMA_WHEEL): | $(BIN)/python
	@mkdir -p $(WHEELS) && rm -f $(WHEELS)/*.whl
	@printf '%s\n' '# Half of the build time, and not part of the package that is installed.' \
		'set(LLAMA_BUILD_COMMON OFF)' \
		'# On virtual machines that offer AMX, its tiles end the process: the code for it is left out.' \
		'add_compile_options(-U__AMX_INT8__)' > $(VENV)/llama-build.cmake
	@sed -n '/^$(LLAMA) /,/[^\]$$/p' $(PINS) > $(VENV)/llama.txt
	@echo "Building llama.cpp, once, about 2 minutes on two cores (pip keeps it for other clones)"
	@set -o pipefail; \
	CMAKE_ARGS="$$CMAKE_ARGS -DLLAVA_BUILD=OFF '-DCMAKE_PROJECT_llama.cpp_INCLUDE=$(CURDIR)/$(VENV)/llama-build.cmake'" \
	$(PIP) wheel --verbose --no-deps --require-hashes --wheel-dir $(WHEELS) \
		--requirement $(VENV)/llama.txt \
		$(call calmly,$(VENV)/llama-build.log); \
		echo "It needs a C and C++ compiler; on Debian and Ubuntu: apt install build-essential"; exit 1; }
	@touch $@
	@echo "llama.cpp is ready"

# Libraries come in the versions and with the hashes of $(PINS), which has a section for each
# target; only the project itself, which is a folder, can have no hash. What is imported at the
# start is compiled to bytecode by pip, and here what pip does not see.
$(VENV)/.libraries-base: SECTIONS := console
$(VENV)/.libraries-core: SECTIONS := console core-test
$(VENV)/.libraries-test: SECTIONS := console core-test test
$(VENV)/.libraries-dev: SECTIONS := console core-test test lint
$(VENV)/.libraries-%: pyproject.toml $(PINS) | $(BIN)/python
	@echo "Installing PA Console and its libraries ($(SECTIONS)) meanwhile, about a minute"
	@$(call sections,$(SECTIONS)) | sed '/^$(LLAMA) /,/[^\]$$/d' > $(VENV)/pins.txt
	@{ $(PIP) install --require-hashes --no-deps --requirement $(VENV)/pins.txt && \
		$(PIP) install --no-deps --no-build-isolation --editable . && \
		$(BIN)/python -m compileall -q pa_console; \
	} > $(VENV)/install.log 2>&1 || { tail -n 25 $(VENV)/install.log; \
		echo "The installation failed; the whole output is in $(VENV)/install.log."; exit 1; }
	@touch $@

# Fetches models as long as llama.cpp is compiled. What is missing then is fetched in sight, from
# where this has stopped, and so is what has failed here: nobody sees that. With `set -m` the
# fetching can be interrupted, and ends its own children then.
.PHONY: fetched-meanwhile
fetched-meanwhile: $(VENV)/.libraries-base
	@set -m; \
	$(BIN)/pa-console models pull --fetch-only $(READER) > $(VENV)/fetch.log 2>&1 < /dev/null & \
	fetching=$$!; set +m; trap 'kill -INT $$fetching 2> /dev/null; wait $$fetching' EXIT; \
	while [ ! -e $(LLAMA_WHEEL) ] && kill -0 $$fetching 2> /dev/null; do sleep 1; done

# The compiler is busy for minutes, the network is not: both at once.
$(VENV)/.installed-base: MEANWHILE := fetched-meanwhile
$(VENV)/.installed-%: pyproject.toml $(PINS) | $(BIN)/python
	@$(MAKE) --no-print-directory --silent --jobs=3 $(LLAMA_WHEEL) $(VENV)/.libraries-$* $(MEANWHILE)
	@$(PIP) install --quiet --no-index --no-deps $(WHEELS)/*.whl
	@touch $@

# Torch comes for the processor or the graphics card that is here, so it has no pinned hash.
$(VENV)/.installed-train: pyproject.toml $(VENV)/.installed-base
	@echo "Installing what trains, some minutes"
	@set -o pipefail; $(PIP) install --no-build-isolation --editable '.[train]' \
		$(call calmly,$(VENV)/install.log); exit 1; }
	@touch $@

$(VENV)/.installed-site: $(PINS) | $(BIN)/python
	@echo "Installing what renders the manual"
	@$(call sections,site) > $(VENV)/site-pins.txt
	@set -o pipefail; $(PIP) install --require-hashes --requirement $(VENV)/site-pins.txt \
		$(call calmly,$(VENV)/install.log); exit 1; }
	@touch $@

$(VENV)/.installed-audit: $(PINS) | $(BIN)/python
	@echo "Installing what lists and audits the libraries"
	@$(call sections,audit) > $(VENV)/audit-pins.txt
	@set -o pipefail; $(PIP) install --require-hashes --requirement $(VENV)/audit-pins.txt \
		$(call calmly,$(VENV)/install.log); exit 1; }
	@touch $@
