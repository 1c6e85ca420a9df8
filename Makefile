# SPDX-License-Identifier: Apache-2.0
# Thin on purpose: each target is a script's name. See README.md.
MISSION ?= short
SEED ?= 1
RVIZ ?=
export MISSION SEED RVIZ

.PHONY: setup build demo test bench
setup build:
	@tools/setup.sh
demo: setup
	@tools/run demo
test: setup
	@tools/run test
bench: setup
	@tools/run bench
