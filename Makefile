# Every target sets up what it needs: a virtual environment in .venv with the pinned versions of constraints.txt.
# Needs only python3 (3.11+), python3-venv, git and make.

PYTHON ?= python3
VENV := .venv
# Where `make install` puts the two commands: a directory that Debian and Ubuntu have on the PATH once it exists.
PREFIX ?= $(HOME)/.local
BIN := $(VENV)/bin
EXTRAS := onboard,shore,report
# Three kinds of tests. PURE ones burn a core each: one worker for each, and they give way to all others
# (tests/give_way.py). All others start real programs and wait for them most of the time: several workers, each with
# pseudo-terminals of its own, which needs root (tests/own_terminals.py); then those that judge processor time or delays,
# marked `in_pairs` or `alone`.
# Empty on a machine that others keep busy, where these tests would wait for hours: make test GIVE_WAY=
GIVE_WAY ?= 1
# Among the pure ones a few files look at a real clock, too: they go with the others.
CLOCK := $(addprefix tests/,acquire/test_ports.py $(addprefix simulate/,test_player.py test_virtual_boat.py test_virtual_command.py))
PURE := $(addprefix tests/,acquire lab layout messages navigate simulate station)
REAL := $(addprefix tests/,floor link service system) $(CLOCK)
# Of the pure ones, those that can differ from Python to Python: argparse, files, warnings, the libraries of exports.
DIFFERING := $(addprefix tests/,layout messages station)
TOGETHER := $(MAKE) --no-print-directory --keep-going --jobs=2 --output-sync=target

.PHONY: demo install test test-slow fast differing differing-pure lint-and-fast-pure fast-pure fast-real slow-pure slow-real golden soak nightly loopback lint check-python clean help

help:
	@echo "make demo       a whole boat on this machine: table and picture in demo-out/"
	@echo "make install    wayfix and wayfix-onboard on the PATH (PREFIX=$(PREFIX))"
	@echo "make test       lint, types, import rules and the fast tests"
	@echo "make test-slow  whole runs, link faults, statistics, Debian 12's own libraries, a real systemd"
	@echo "make golden     replay the golden cases and write what they give now; read the difference (tests/golden)"
	@echo "make soak       two hours, by hand; figures go to benchmarks/"
	@echo "make nightly    the daemon on emulated ARM (armhf, arm64) with Debian's packages; as root"
	@echo "make loopback   fake serial ports -> daemon -> socket -> filter -> log"

check-python:
	@command -v $(PYTHON) >/dev/null || { echo "python3 is missing; apt-get install python3 python3-venv"; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "$$($(PYTHON) --version) is too old, 3.11 is needed; call make PYTHON=python3.11"; exit 2; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "python3-venv is missing; apt-get install python3-venv"; exit 2; }

$(VENV)/run.stamp: pyproject.toml constraints.txt | check-python
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS)]'
	@touch $@

# It holds what run.stamp stands for: one installation, not two.
$(VENV)/dev.stamp: pyproject.toml constraints.txt | check-python
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS),dev]'
	@touch $(VENV)/run.stamp $@

demo: $(VENV)/run.stamp
	$(BIN)/wayfix demo --log demo-out

install: $(VENV)/run.stamp
	@mkdir -p '$(PREFIX)/bin'
	@for each in wayfix wayfix-onboard; do ln -sf '$(CURDIR)/$(BIN)'/$$each '$(PREFIX)/bin'/$$each; done
	@echo "wayfix and wayfix-onboard are in $(PREFIX)/bin; they run from $(CURDIR)"
	@case ":$$PATH:" in *":$(PREFIX)/bin:"*) ;; *) echo "$(PREFIX)/bin is not on your PATH: PATH=\$$PATH:$(PREFIX)/bin for this terminal" ;; esac

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: $(VENV)/dev.stamp
	@$(TOGETHER) lint-and-fast-pure fast-real

fast: $(VENV)/dev.stamp
	@$(TOGETHER) fast-pure fast-real

differing: $(VENV)/dev.stamp
	@$(TOGETHER) differing-pure fast-real

test-slow: $(VENV)/dev.stamp
	@$(TOGETHER) slow-pure slow-real
	$(BIN)/pytest -q -m "slow and alone" $(REAL)

lint-and-fast-pure: lint
	@$(MAKE) --no-print-directory fast-pure

fast-pure slow-pure differing-pure fast-real slow-real: $(VENV)/dev.stamp
fast-pure differing-pure: TIER := not slow
slow-pure: TIER := slow
differing-pure: PURE := $(DIFFERING)
AS_ROOT = $(if $(filter 0,$(shell id -u)),$(1),0)

fast-pure slow-pure differing-pure:
	WAYFIX_GIVE_WAY=$(GIVE_WAY) $(BIN)/pytest -q -m "$(TIER) and not alone" -n auto --dist worksteal $(PURE) $(CLOCK:%=--ignore=%)

# Each line of pytest runs whatever became of the one before.
fast-real:
	@failed=0; \
	$(BIN)/pytest -q -m "not slow and not alone and not in_pairs" -n $(call AS_ROOT,4) --dist worksteal $(REAL) || failed=1; \
	$(BIN)/pytest -q -m "not slow and (alone or in_pairs)" $(REAL) || failed=1; \
	exit $$failed

slow-real:
	@failed=0; \
	$(BIN)/pytest -q -m "slow and not alone and not in_pairs" -n $(call AS_ROOT,6) --dist worksteal $(REAL) || failed=1; \
	$(BIN)/pytest -q -m "slow and in_pairs" -n $(call AS_ROOT,2) --dist loadfile $(REAL) || failed=1; \
	exit $$failed

golden: $(VENV)/dev.stamp
	$(BIN)/python -m tests.golden.refresh

loopback: $(VENV)/dev.stamp
	$(BIN)/pytest tests/system/test_loopback.py

soak: $(VENV)/dev.stamp
	WAYFIX_OUTAGE_S=300 $(BIN)/pytest -s tests/system/test_outages.py
	$(BIN)/python -m benchmarks.link stalled --seconds 600
	$(BIN)/python -m benchmarks.churn --minutes 30
	$(BIN)/python -m benchmarks.daemon_load --seconds 3600

nightly: $(VENV)/run.stamp
	tests/arm/smoke.sh $(BIN)/pip

clean:
	rm -rf $(VENV) demo-out .mypy_cache .ruff_cache .pytest_cache .hypothesis
