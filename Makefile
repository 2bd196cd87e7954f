# Every target sets up what it needs: a virtual environment in .venv with the pinned versions of constraints.txt.
# Needs only python3 (3.11+), python3-venv, git and make.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
EXTRAS := onboard,shore,report
FAST := -m "not slow"
# Tests whose result no other work on the machine can change run on all cores: those that wait for no clock, and those
# that wait most of their time.
PURE := $(addprefix tests/,acquire floor lab layout link messages navigate simulate station)
WAITING := $(addprefix tests/system/test_,outages.py board_ends.py meeting.py wrong_clocks.py addresses.py)
REAL := $(addprefix --ignore=,$(PURE) $(WAITING))

.PHONY: demo test test-slow golden soak nightly loopback lint check-python clean help

help:
	@echo "make demo       a whole boat on this machine: table and picture in demo-out/"
	@echo "make test       lint, types, import rules and the fast tests"
	@echo "make test-slow  whole runs, link faults, statistics, Debian 12's own libraries, a real systemd"
	@echo "make golden     replay the golden cases and write what they give now; read the difference (tests/golden)"
	@echo "make soak       an hour and a half, by hand; figures go to benchmarks/"
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

$(VENV)/dev.stamp: $(VENV)/run.stamp
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS),dev]'
	@touch $@

demo: $(VENV)/run.stamp
	$(BIN)/wayfix demo --log demo-out --json

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint
	$(BIN)/pytest $(FAST) -n auto $(PURE)
	$(BIN)/pytest $(FAST) $(REAL)

test-slow: $(VENV)/dev.stamp
	$(BIN)/pytest -m slow -n auto $(PURE)
	$(BIN)/pytest -m slow -n 6 $(WAITING)
	$(BIN)/pytest -m slow $(REAL)

golden: $(VENV)/dev.stamp
	$(BIN)/python -m tests.golden.refresh

loopback: $(VENV)/dev.stamp
	$(BIN)/pytest tests/system/test_loopback.py

soak: $(VENV)/dev.stamp
	WAYFIX_OUTAGE_S=300 $(BIN)/pytest -s tests/system/test_outages.py
	$(BIN)/python -m benchmarks.link stalled --seconds 600
	$(BIN)/python -m benchmarks.daemon_load --seconds 3600

nightly: $(VENV)/run.stamp
	tests/arm/smoke.sh $(BIN)/pip

clean:
	rm -rf $(VENV) demo-out .mypy_cache .ruff_cache .pytest_cache .hypothesis
