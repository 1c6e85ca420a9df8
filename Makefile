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

.PHONY: setup build demo play test bench bench-tracking bench-gimbal bench-link bench-sigma bench-survey rehearse study docs fresh
setup build:
	@tools/setup.sh
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
