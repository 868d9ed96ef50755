# Targets explain themselves: `make` lists them.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
EVAL_STAMP := $(VENV)/.installed-eval
TRAIN_STAMP := $(VENV)/.installed-train
# which torch to train with; CPU builds come from PyTorch's own index (see the README)
TORCH ?= torch>=2.2,<2.15
# how long `make fuzz` goes on, and with which seed it begins
MINUTES ?= 10
FIRST ?= 0
RUN := out/paper/run
PRIOR := out/prior
DEMO := out/demo
PYTEST := $(BIN)/python -m pytest -n 2 --dist worksteal
# what has targets of its own is not tested with the codec
CODEC := tests --ignore tests/lab --ignore tests/evaluation --ignore tests/training
# what shows that other versions of the dependencies do: every conformance stream, exact arithmetic, PLY files
VERSIONED := tests/conformance/test_conformance.py tests/unit/entropy tests/unit/transform tests/unit/test_ply.py

.DEFAULT_GOAL := help
.PHONY: help env env-eval env-train demo test test-slow test-oldest test-newest test-evaluation test-training test-player train train-prior check format core player player-package fuzz fuzz-core golden cli-page clean \
	bench bench-full bench-quick bench-speed bench-zstd bench-spz bench-memory bench-motion bench-paper bench-intra bench-quantised bench-since bench-identity bench-smooth bench-troubles bench-captures bench-promise drift stress allocation charts picture fitted captures

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-16s %s\n", $$1, $$2}'

$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

env: $(STAMP) ## a virtual environment with the codec and all that its development needs

$(EVAL_STAMP): $(STAMP)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,eval]'
	touch $@

env-eval: $(EVAL_STAMP) ## the same with renderer, baselines and charts

$(TRAIN_STAMP): $(EVAL_STAMP)
	$(BIN)/pip install --quiet --disable-pip-version-check '$(TORCH)'
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,eval,train]'
	touch $@

env-train: $(TRAIN_STAMP) ## the same with torch, for training

demo: $(STAMP) ## the main job on a real moving sequence: make frames, encode, decode in a fresh process, verify
	rm -rf $(DEMO)
	$(BIN)/python -m lab.scenes assets/playbot_31k_sh2.ply $(DEMO)/frames --frames 10 --motion part --variant noisy
	$(BIN)/python -m lab.scenes assets/Fox.glb $(DEMO)/fox --frames 10 --gaussians 20000 --clip Run
	$(BIN)/dfcgs encode $(DEMO)/frames $(DEMO)/playbot.dgs --verify
	$(BIN)/dfcgs encode $(DEMO)/fox $(DEMO)/fox.dgs --verify
	$(BIN)/dfcgs decode $(DEMO)/playbot.dgs $(DEMO)/decoded
	$(BIN)/dfcgs info $(DEMO)/playbot.dgs --frames
	@echo
	@echo "frames in:   $(DEMO)/frames    ($$(du -sk $(DEMO)/frames | cut -f1) kB)"
	@echo "file:        $(DEMO)/playbot.dgs ($$(du -sk $(DEMO)/playbot.dgs | cut -f1) kB)"
	@echo "frames out:  $(DEMO)/decoded   (open them in any 3DGS viewer)"

test: $(STAMP) ## the tests of the codec, but for the slow ones
	$(PYTEST) $(CODEC)

test-slow: $(STAMP) ## exhaustive products and long random searches, which `make test` has a part of
	$(PYTEST) $(CODEC) -m slow

test-oldest: $(STAMP) ## the commands and their bytes with the oldest version of every dependency that is allowed
	mkdir -p out
	$(BIN)/python tools/oldest_versions.py > out/oldest.txt
	$(PYTHON) -m venv .venv-oldest
	.venv-oldest/bin/pip install --quiet --disable-pip-version-check --constraint out/oldest.txt --editable . pytest pytest-timeout hypothesis
	$(BIN)/python tools/compare_versions.py $(BIN)/python .venv-oldest/bin/python
	.venv-oldest/bin/python -m pytest $(VERSIONED)

test-newest: $(STAMP) ## the same with the newest
	$(PYTHON) -m venv .venv-newest
	.venv-newest/bin/pip install --quiet --disable-pip-version-check --upgrade --upgrade-strategy eager --editable . pytest pytest-timeout hypothesis
	$(BIN)/python tools/compare_versions.py $(BIN)/python .venv-newest/bin/python
	.venv-newest/bin/python -m pytest $(VERSIONED)

test-evaluation: env-eval ## the tests of renderer, metrics and baselines, which need the extra [eval]
	$(PYTEST) tests/lab tests/evaluation -m ''

test-training: env-train ## the tests of training and fitting, which need torch
	$(PYTEST) tests/training

train: env-train ## train the model of profile paper anew (an hour; goes on where it stopped) and export it into out/
	$(BIN)/python -m training.paper train --out $(RUN) --seed 1 $(if $(wildcard $(RUN)/checkpoint.pt),--resume,--minutes 60)
	$(BIN)/python -m training.paper export $(RUN) --model-id paper-1 --out $(RUN)

train-prior: env-train ## train the prior of profile main anew (half an hour; goes on where it stopped) and export it into out/
	$(BIN)/python -m training.prior --recordings $(PRIOR)/first record --takes 16
	$(BIN)/python -m training.prior --recordings $(PRIOR)/first train --out $(PRIOR)/first-1 --steps 1500
	$(BIN)/python -m training.prior --recordings $(PRIOR)/second record --model $(PRIOR)/first-1.weights
	$(BIN)/python -m training.prior --recordings $(PRIOR)/second train --out $(PRIOR)/main-1 --steps 8000

check: $(STAMP) ## lint, types, import floors
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP) ## lay the code out
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

fuzz: $(STAMP) ## break files in ways that keep their checksums right, for 10 minutes: make fuzz MINUTES=60 FIRST=1000000
	$(BIN)/python tools/fuzz.py --minutes $(MINUTES) --first $(FIRST)

core: $(STAMP) ## build the C core to the WebAssembly module of the package, with a compiler from PyPI
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[core]'
	$(BIN)/python tools/build_core.py

fuzz-core: $(STAMP) ## break files for the C core under sanitizers (clang, or gcc): make fuzz-core MINUTES=60
	$(BIN)/python tools/fuzz_core.py --seconds $$((60 * $(MINUTES))) --first $(FIRST)

golden: $(STAMP) ## write the conformance streams (refuses to touch a released version)
	$(BIN)/python tools/make_golden.py

bench: env-eval ## the comparison: all scenes, methods, settings (an hour and a half; resumes), then charts and tables
	$(BIN)/python -m evaluation.bench
	$(MAKE) bench-captures drift stress charts

bench-full: env-eval ## the comparison from all 8 views, for a release
	$(BIN)/python -m evaluation.bench --full

bench-quick: env-eval ## four scenes, six frames, the quick methods (under 10 minutes)
	$(BIN)/python -m evaluation.bench --quick

bench-motion: env-eval ## what motion and its parts are worth: ablations (two hours)
	$(BIN)/python -m evaluation.experiments.motion

bench-paper: env-eval ## profile paper against main, and the paper's tables (an hour)
	$(BIN)/python -m evaluation.experiments.paper.profile
	$(BIN)/python -m evaluation.experiments.paper.ablations

bench-smooth: env-eval ## smooth scenes of 60 frames against quantised delta + zstd (an hour)
	$(BIN)/python -m evaluation.experiments.long_smooth

bench-captures: env-eval ## rooms seen from within: presets with and without cameras, uniform steps, delta + zstd (half an hour; resumes)
	$(BIN)/python -m evaluation.captures

bench-promise: env-eval ## are frames as good as the presets promise, and as the encoder says? (ten minutes)
	$(BIN)/python -m evaluation.promise

bench-intra: env-eval ## I-frames alone against SPZ, SOG and themselves without grading (half an hour)
	$(BIN)/python -m evaluation.experiments.i_frames.intra

bench-surroundings: env-eval ## objects in rooms, under domes, in haze: does the codec see them? (20 minutes)
	$(BIN)/python -m evaluation.experiments.i_frames.surroundings

bench-quantised: env-eval ## splats that another tool has quantised: what keeping their values saves (ten minutes)
	$(BIN)/python -m evaluation.experiments.i_frames.quantised_input

bench-since: env-eval ## BD-rate of our curves against those of another commit: make bench-since COMMIT=...
	$(BIN)/python -m evaluation.experiments.since $(COMMIT)

bench-identity: env-eval ## are Gaussians found again whose order is lost? fails where a bar is missed (10 minutes)
	$(BIN)/python -m evaluation.experiments.identity

drift: env-eval ## 300 frames at five GoF sizes against all-intra
	$(BIN)/python -m evaluation.experiments.drift

stress: env-eval ## the sequences that break codecs; fails where one misses a bar
	$(BIN)/python -m evaluation.stress

allocation: env-eval ## are the quantiser steps in the right proportion?
	$(BIN)/python -m evaluation.experiments.i_frames.allocation

charts: env-eval ## docs/charts/*.svg, and the tables of the README and of all pages in docs/, from evaluation/results
	$(BIN)/python -m evaluation.charts
	$(BIN)/python -m evaluation.tables

picture: env-eval ## docs/picture.webp, a capture's input beside decoded frames (ten minutes)
	$(BIN)/python -m evaluation.picture

bench-troubles: env-eval ## far Gaussians, headers, small files that ask for much: fails where a bar is missed (half an hour)
	$(BIN)/python -m evaluation.troubles
	$(BIN)/python -m evaluation.experiments.far_values
	$(BIN)/python -m evaluation.experiments.appearing

bench-zstd: env-eval ## against "quantised delta + zstd" at equal errors
	$(BIN)/python -m evaluation.experiments.against_zstd

bench-spz: env-eval ## I-frames against SPZ version 4 at equal errors
	$(BIN)/python -m evaluation.experiments.i_frames.against_spz

bench-speed: env-eval ## encode and decode times
	$(BIN)/python -m evaluation.speed

bench-memory: env-eval ## peak memory of a long sequence
	$(BIN)/python -m evaluation.memory

captures: env-eval ## rebuild the captures of rooms into out/captures (hours; goes on where it stopped)
	$(BIN)/python -m training.captures --out out/captures

fitted: env-eval ## rebuild the fitted training sequence into out/ (about 15 minutes)
	$(BIN)/python -m training.fitting fitted_barbarian --out out/fitted_barbarian.zip

cli-page: $(STAMP) ## docs/cli.md from the definitions of the commands
	$(BIN)/python tools/make_cli_page.py

player/node_modules: player/package-lock.json
	npm ci --prefix player --no-audit --no-fund
	touch $@

player: player/node_modules ## the player of the package, from player/ (needs Node)
	npm run --prefix player check
	npm run --prefix player build

player-package: player/node_modules $(STAMP) ## player/dfcgs-player-*.tgz, the npm package
	mkdir -p player/dist
	$(BIN)/python -c "from dfcgs_codec.player.assets import assets_json; print(assets_json())" > player/dist/assets.json
	cd player && npm pack

test-player: env-eval player-package ## the player in a real browser (chromium), and whether its build is up to date
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,eval,player]'
	npm run --prefix player check
	cd player && node build.mjs check
	$(BIN)/python -m pytest tests/player

clean: ## remove what was built
	rm -rf out build $(VENV) .venv-oldest .venv-newest
