# Targets explain themselves: `make` lists them.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO := out/demo

.DEFAULT_GOAL := help
.PHONY: help env demo test test-render check format golden bench-speed bench-zstd bench-spz bench-memory bench clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-13s %s\n", $$1, $$2}'

$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

env: $(STAMP) ## a virtual environment with the codec and all that its development needs

demo: $(STAMP) ## the main job on a real moving sequence: make frames, encode, decode in a fresh process, verify
	rm -rf $(DEMO)
	$(BIN)/python -m training.scenes assets/playbot_31k_sh2.ply $(DEMO)/frames --frames 10 --motion part --variant noisy
	$(BIN)/python -m training.scenes assets/Fox.glb $(DEMO)/fox --frames 10 --gaussians 20000 --clip Run
	$(BIN)/dfcgs encode $(DEMO)/frames $(DEMO)/playbot.dgs --verify
	$(BIN)/dfcgs encode $(DEMO)/fox $(DEMO)/fox.dgs --verify
	$(BIN)/dfcgs decode $(DEMO)/playbot.dgs $(DEMO)/decoded
	$(BIN)/dfcgs info $(DEMO)/playbot.dgs --frames
	@echo
	@echo "frames in:   $(DEMO)/frames    ($$(du -sk $(DEMO)/frames | cut -f1) kB)"
	@echo "file:        $(DEMO)/playbot.dgs ($$(du -sk $(DEMO)/playbot.dgs | cut -f1) kB)"
	@echo "frames out:  $(DEMO)/decoded   (open them in any 3DGS viewer)"

test: $(STAMP) ## all tests
	$(BIN)/python -m pytest -n 2

test-render: $(STAMP) ## the tests of the evaluation's renderer, which needs numba (and torch for its oracle)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,eval]'
	$(BIN)/python -m pytest tests/evaluation

check: $(STAMP) ## lint, types, import floors
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP) ## lay the code out
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

golden: $(STAMP) ## write the conformance streams (refuses to touch a released version)
	$(BIN)/python tools/make_golden.py

bench-zstd: $(STAMP) ## against "quantised delta + zstd": evaluation/results/against_zstd.json
	$(BIN)/python -m evaluation.against_zstd

bench-spz: $(STAMP) ## I-frames against SPZ version 4: evaluation/results/against_spz.json
	$(BIN)/pip install --quiet --disable-pip-version-check gaussforge==0.6.0
	$(BIN)/python -m evaluation.against_spz

bench-speed: $(STAMP) ## encode and decode times: evaluation/results/speed.json
	$(BIN)/python -m evaluation.speed

bench-memory: $(STAMP) ## peak memory of a long sequence: evaluation/results/memory.json
	$(BIN)/python -m evaluation.memory

bench: bench-speed bench-zstd bench-spz bench-memory ## all measurements, then the README's tables
	$(BIN)/python -m evaluation.readme

clean: ## remove what was built
	rm -rf out build $(VENV)
