# Two commands matter: `make run` assembles one bracket in simulation, `make test` runs the tests.
# Both set up all they need in .venv; stamp files there make every later call instant.

SHELL := /bin/bash
.SHELLFLAGS := -e -u -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: three vsix judge help run test test-contracts test-all check site sbom bench bench-long pictures train-deps weights hands readers constraints doctor clean .venv/browser

PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3)
BIN := .venv/bin
PACKAGES := ground engine cell sim lab
RUNTIME := --editable ./ground --editable ./engine --editable ./cell --editable ./sim
SYSTEM_PACKAGES := libegl1 libgl1-mesa-dri libopengl0 libosmesa6 fonts-dejavu-core
RUN_ARGS ?= --goal random --seed 1
TEST_ARGS ?=
WEIGHTS_ARGS ?=
JUNIT ?=
export JUNIT

# uv installs in seconds what pip installs in minutes; it gets the settings that this machine gives to pip.
pip_setting = $(shell $(BIN)/python -m pip config get $(1) 2>/dev/null)
index = $(or $(UV_DEFAULT_INDEX),$(PIP_INDEX_URL),$(call pip_setting,global.index-url))
certificates = $(or $(PIP_CERT),$(call pip_setting,global.cert))
uv_setting = $(if $(2),$(1)="$(2)")
uv_settings = $(call uv_setting,UV_DEFAULT_INDEX,$(index)) $(call uv_setting,SSL_CERT_FILE,$(certificates)) \
  $(call uv_setting,UV_FIND_LINKS,$(or $(UV_FIND_LINKS),$(PIP_FIND_LINKS))) UV_HTTP_TIMEOUT=180
UV = $(uv_settings) $(BIN)/uv pip install --quiet --python $(BIN)/python --compile-bytecode \
  --constraints constraints-hashed.txt --build-constraints constraints-hashed.txt
# What breaks an installation off leaves this file, and the next call makes .venv anew; a failure that is told does not.
UNFINISHED := .venv/unfinished
ifneq ($(wildcard $(UNFINISHED)),)
  $(info the last installation was broken off: .venv is made anew)
  $(shell rm -rf .venv)
endif
whole = mkdir -p .venv; touch $(UNFINISHED); status=0; { $(1); } || status=$$?; rm -f $(UNFINISHED); [ $$status = 0 ] || exit $$status
APT := export DEBIAN_FRONTEND=noninteractive; apt-get update -qq && apt-get install -y -qq --no-install-recommends
export OMP_NUM_THREADS := 1

help:
	@echo "make run        assemble one bracket in simulation (RUN_ARGS=\"--goal g0 --seed 3\")"
	@echo "make test       run the tests (TEST_ARGS=\"tests/sim -k arm\" for some; JUNIT=FOLDER for JUnit files)"
	@echo "make test-contracts  what every device must do, simulated, recorded and behind a twin's wires"
	@echo "make check      ruff, mypy, import-linter, sizes of rooms, the site"
	@echo "make site       the documentation as a site, in site/"
	@echo "make judge      BehaviorTree.CPP from its sources (BTCPP_SOURCE=FOLDER), which random trees are compared with"
	@echo "make vsix       the extension for Visual Studio Code, into build/ (needs npm)"
	@echo "make sbom       all that the program is made of, as CycloneDX, in build/sbom.json"
	@echo "make bench      benchmarks"
	@echo "make bench-long  benchmarks that take hours"
	@echo "make test-all   the tests and the long experiments"
	@echo "make train-deps what 'cell train' needs (4.7 GB)"
	@echo "make weights    all shipped weights again, into trained/ (four hours of one core; WEIGHTS_ARGS=\"--plan\" says what it does)"
	@echo "make hands      fetch MediaPipe's hand networks into ~/.cache/cell (35 MB, Apache 2.0)"
	@echo "make readers    .venv-readers: LeRobot and Stable-Baselines3, which 'make test-all' trains policies with (0.7 GB)"
	@echo "make pictures   docs: film and pictures, README's sample, the pages of all keys and of figures"
	@echo "make constraints  newest versions of all packages, with hashes, into constraints*.txt"
	@echo "make doctor     what is missing on this machine"

run: .venv/system
	$(BIN)/cell run $(RUN_ARGS)

doctor: .venv/runtime
	$(BIN)/cell doctor

test: .venv/tests .venv/system .venv/browser
	.ci/test $(BIN)/python test "not slow and not long" auto $(TEST_ARGS)

test-long: .venv/tests .venv/system .venv/browser
	.ci/test $(BIN)/python test-long "long and not slow" auto $(TEST_ARGS)

test-contracts: .venv/tests .venv/system
	.ci/test $(BIN)/python test-contracts contract auto $(TEST_ARGS)

test-all: .venv/tests .venv/system .venv/browser
	.ci/test $(BIN)/python test-all "" 0 $(TEST_ARGS)

check: .venv/tests .venv/site
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tests.ceilings
	@$(MAKE) --no-print-directory site

# A link that leads nowhere, or a page that nothing leads to, is a failure.
site: .venv/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

sbom: .venv/tests
	$(BIN)/python -m tests.docs.sbom build/sbom.json

bench: .venv/tests .venv/system
	$(BIN)/python -m tests.benchmarks.tree_ticks
	$(BIN)/python -m tests.benchmarks.node_ticks
	$(BIN)/python -m tests.benchmarks.planning
	$(BIN)/python -m tests.benchmarks.inverse_kinematics
	$(BIN)/python -m tests.benchmarks.perception_accuracy
	$(BIN)/python -m tests.benchmarks.robot_alone pick_and_place
	$(BIN)/python -m tests.benchmarks.robot_alone clutter
	$(BIN)/python -m tests.benchmarks.assembly

# What is measured at a release and takes hours; each says by --help what it can be asked.
bench-long: .venv/tests .venv/system
	$(BIN)/python -m tests.benchmarks.killed_shift --folder runs/killed_shift
	$(BIN)/python -m tests.benchmarks.work_orders
	$(BIN)/python -m tests.benchmarks.human_hand
	$(BIN)/python -m tests.benchmarks.foresight

pictures: .venv/tests .venv/system
	$(BIN)/python -m tests.docs.pictures

# The page's three-dimensional view: one file and its licence, as they are in the package.
THREE = 0.170.0
three:
	cd cell/bracket_cell/viewing/page/static/three && npm pack --silent three@$(THREE) && \
	  tar -xzf three-$(THREE).tgz --strip-components=1 package/LICENSE && \
	  tar -xzf three-$(THREE).tgz --strip-components=2 package/build/three.module.min.js && rm three-$(THREE).tgz

# The client that the extension needs goes into the package; vsce is npm's own tool for it.
VSIX ?= build/bracket-cell.vsix
VSCE := 3.9.2
vsix:
	@mkdir -p build/vscode $(dir $(VSIX)) && cp -r editor/vscode/. build/vscode && cp LICENSE editor/README.md build/vscode
	cd build/vscode && npm install --silent --no-audit --no-fund --omit=dev --no-package-lock && \
	  npx --yes @vscode/vsce@$(VSCE) package --allow-missing-repository --out $(abspath $(VSIX))

# BehaviorTree.CPP 4.10 as the judge of random trees; without it those tests are skipped, and say so.
JUDGE := build/judge
judge: $(JUDGE)
$(JUDGE): tests/trees/engine/judge.cpp
	@test -n "$(BTCPP_SOURCE)" || { echo "BTCPP_SOURCE=FOLDER names the sources of BehaviorTree.CPP"; exit 2; }
	cmake -S "$(BTCPP_SOURCE)" -B build/btcpp -DCMAKE_BUILD_TYPE=Release -DBTCPP_SHARED_LIBS=OFF -DBTCPP_EXAMPLES=OFF \
	  -DBTCPP_BUILD_TOOLS=OFF -DBUILD_TESTING=OFF -DBTCPP_GROOT_INTERFACE=OFF -DBTCPP_SQLITE_LOGGING=OFF >/dev/null
	cmake --build build/btcpp --target behaviortree_cpp
	$(CXX) -O1 -std=c++17 -I"$(BTCPP_SOURCE)/include" $< -o $@ build/btcpp/libbehaviortree_cpp.a \
	  $$(find build/btcpp/3rdparty -name '*.a') -lpthread -ldl

train-deps: .venv/tests

weights: .venv/tests .venv/system
	$(BIN)/cell train --all $(WEIGHTS_ARGS)

hands: .venv/tests
	$(BIN)/cell lab hands

# Readers of the formats that logs are exported to, and learners; torch and the cell are those of .venv. LeRobot asks for
# older packages than these work with, so what it needs is named here.
readers: .venv/tests
	$(BIN)/uv venv --quiet --python $(BIN)/python .venv-readers
	$(uv_settings) $(BIN)/uv pip install --quiet --python .venv-readers/bin/python --no-deps lerobot==0.4.4 \
	  accelerate==1.* torchcodec==0.17.* diffusers==0.* stable-baselines3==2.*
	$(uv_settings) $(BIN)/uv pip install --quiet --python .venv-readers/bin/python av cachebox datasets==5.* deepdiff \
	  draccus==0.10.0 einops huggingface-hub imageio importlib-metadata jsonlines matplotlib 'numpy<2.4' packaging \
	  pandas psutil pyarrow pyserial regex safetensors termcolor
	$(BIN)/python -c "import sysconfig; print(f'import site; site.addsitedir(\"{sysconfig.get_path(\"purelib\")}\")')" > \
	  $$(.venv-readers/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/zz_torch.pth
	@ldconfig -p | grep -q libavcodec || if [ "$$(id -u)" = 0 ]; then $(APT) ffmpeg >/dev/null; \
	  else echo "ffmpeg is missing: sudo apt-get install -y ffmpeg"; exit 2; fi

# The ranges of pyproject.toml hold; what they allow is pinned by name, version and hash, without addresses. pip takes no
# hash beside a folder that it installs, so it gets the same pins without them.
constraints: .venv/uv
	{ echo '# All packages, pinned, with the hashes of their files. Made by: make constraints'; \
	  $(uv_settings) $(BIN)/uv pip compile --quiet --all-extras --no-header --no-annotate --no-emit-index-url \
	  --generate-hashes --python-version 3.11 --group docs --group dev \
	  $$(sed -n 's/^name = "\(.*\)"/--no-emit-package \1/p' $(MEMBERS)) $(MEMBERS); } > constraints.new
	{ echo '# All packages, pinned. Made by: make constraints'; sed -n 's/^\([a-z0-9-]*==[^ ]*\).*/\1/p' constraints.new; } > constraints.txt
	mv constraints.new constraints-hashed.txt

clean:
	rm -rf .venv .venv-readers build site *.egg-info

# Debian's python3 comes without ensurepip.
.venv/uv:
	@if ! $(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 13))'; then \
	  echo "Python 3.11 or 3.12 is needed: make run PYTHON=/path/to/python3.11"; exit 2; fi
	@if ! $(PYTHON) -c 'import ensurepip' 2>/dev/null; then \
	  if [ "$$(id -u)" = 0 ]; then $(APT) python3-venv >/dev/null; \
	  else echo "python3-venv is missing: sudo apt-get install -y python3-venv"; exit 2; fi; fi
	@$(call whole,$(PYTHON) -m venv .venv && $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt uv)
	@touch $@

MEMBERS := $(wildcard */pyproject.toml)
.venv/runtime: .venv/uv pyproject.toml $(MEMBERS) constraints-hashed.txt
	@echo 'installing what the cell needs into .venv (1.0 GB)'; $(call whole,$(UV) $(RUNTIME))
	@$(BIN)/python -m compileall -q $(PACKAGES)
	@touch $@

.venv/site: .venv/runtime
	@echo 'installing what the site needs into .venv (0.1 GB)'; $(call whole,$(UV) $(RUNTIME) --group docs)
	@touch $@

.venv/tests: .venv/runtime
	@echo 'installing what tests and training need into .venv (4.7 GB more, torch alone 4.2)'; $(call whole,$(UV) $(RUNTIME) --editable ./lab --group dev)
	@touch $@

# Rendering is tried, not guessed: whatever OpenGL is here may do.
.venv/system: .venv/runtime
	@if ! $(BIN)/python -m bracket_sim.rendering.available; then \
	  if [ "$$(id -u)" = 0 ]; then $(APT) $(SYSTEM_PACKAGES) >/dev/null; \
	    $(BIN)/python -m bracket_sim.rendering.available || { echo "nothing renders here, see: make doctor"; exit 2; }; \
	  else echo "software OpenGL is missing: sudo apt-get install -y $(SYSTEM_PACKAGES)"; exit 2; fi; fi
	@touch $@

# Tests look at the pages that the program makes; without a browser they are skipped.
.venv/browser:
	@if ! { command -v chromium || command -v chromium-browser || command -v google-chrome; } >/dev/null; then \
	  if [ "$$(id -u)" = 0 ]; then echo 'installing a browser for the tests'; $(APT) chromium >/dev/null; \
	  else echo "no browser: tests that look at pages are skipped (sudo apt-get install -y chromium)"; fi; fi
