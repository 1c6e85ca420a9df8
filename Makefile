# SPDX-License-Identifier: Apache-2.0
# Thin on purpose: each target is a script's name. See README.md.
SYSTEM ?=
MISSION ?=
SEED ?= 1
WORLD ?= street
RVIZ ?=
LIVE ?=
MOVERS ?=
NEAR ?=
GPS ?=
CAMERA ?=
START ?=
SPEED ?= auto
OUT ?= out/demo
OVERWRITE ?=
OPERATOR ?=
AUTOPILOT ?=
export SYSTEM MISSION SEED WORLD RVIZ LIVE MOVERS NEAR GPS CAMERA START SPEED OUT OVERWRITE OPERATOR AUTOPILOT

# a mistyped name would be passed over in silence
GIVEN := $(foreach v,$(.VARIABLES),$(if $(filter command,$(firstword $(origin $v))),$v))
KNOWN := SYSTEM MISSION SEED WORLD RVIZ LIVE MOVERS NEAR GPS CAMERA START SPEED OUT OVERWRITE OPERATOR AUTOPILOT ARGS
WRONG := $(filter-out $(KNOWN) MAKEFLAGS MAKEOVERRIDES,$(filter-out -%,$(GIVEN)))
ifneq ($(WRONG),)
$(error no such variable: $(WRONG); known are $(KNOWN))
endif

.PHONY: help setup build demo play test bench bench-tracking bench-gimbal bench-link bench-sigma bench-survey rehearse study docs fresh
setup build:
	@tools/setup.sh
help:
	@echo 'make setup     everything that is needed (the others do it themselves)'
	@echo 'make demo      a flight in simulation and its map: docs/user/simulation.md'
	@echo 'make play      plays a flight back: OUT=out/demo'
	@echo 'make rehearse  a mission with faults, faster than it is flown: MISSION=NAME'
	@echo 'make test      all tests; some of them: ARGS="FILE"'
	@echo 'make docs      the documents as a site'
	@echo 'make bench, bench-tracking, bench-gimbal, bench-link, bench-sigma, bench-survey, study: figures of docs/lab'
	@echo 'make fresh     the first two commands on a bare Debian 12'
	@echo 'variables      $(KNOWN)'
demo: setup
	@tools/run demo
play: setup
	@tools/run play
test: setup
	@tools/run test
bench: setup
	@tools/run bench
bench-tracking: setup
	@tools/run bench-tracking
bench-gimbal: setup
	@tools/run bench-gimbal
bench-link: setup
	@tools/run bench-link
bench-sigma: setup
	@tools/run bench-sigma
bench-survey: setup
	@tools/run bench-survey
rehearse: setup
	@tools/run rehearse
study: setup
	@tools/run study
docs:
	@tools/docs/site.sh
fresh:
	@python3 tools/fresh.py $(ARGS)
