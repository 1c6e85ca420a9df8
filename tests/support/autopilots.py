# SPDX-License-Identifier: Apache-2.0
"""The parameter profile that vehicles fly with."""

from pathlib import Path

from fcsv_control.flight.profile import load_profile

PROFILE_FILE = Path(__file__).resolve().parents[2] / "config/autopilot/arducopter-4.3-t265.param"
PROFILE = load_profile(PROFILE_FILE)
MUST = {rule.name: rule.value for rule in PROFILE if rule.must}
