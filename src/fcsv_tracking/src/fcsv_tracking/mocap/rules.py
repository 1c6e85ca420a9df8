# SPDX-License-Identifier: Apache-2.0
"""How one vehicle is tracked: delays, patience, gates."""

from dataclasses import dataclass, field

from fcsv_geometry.config import require_positive
from fcsv_tracking.mocap.filter import FilterNoise
from fcsv_tracking.mocap.samples import InputRules


@dataclass(frozen=True)
class TrackerRules:
    """How one vehicle is tracked."""

    # the tracker's frame to the stamp of its pose: exposure, network, half a period
    mocap_latency_s: float = 0.011
    odometry_latency_s: float = 0.07  # first guess; the filter learns it in view
    mocap_wait_s: float = 0.03  # how much later a pose may come before odometry goes on without it
    hold_s: float = 0.25  # likewise for odometry: several packets that Wi-Fi loses
    coast_s: float = 0.5  # without odometry and mocap for longer than this there is no pose
    # a frame of the mocap that turns the body by more while odometry is silent: other markers
    coast_deg: float = 6.0
    # odometry silent for longer, out of view: it may have begun anew, the offset is lost
    bridge_s: float = 2.0
    gate_6: float = 30.0  # squared Mahalanobis distances: one in 25 000 by chance
    gate_3: float = 24.0
    dispute_s: float = 0.5  # place in dispute, heading not, for so long: who is right is not known
    # both in dispute: mocap takes something else for the body, until this long
    dispute_all_s: float = 2.0
    confirm_m: float = 0.3  # horizontal movement in view that proves the heading
    blend_mps: float = 0.25
    blend_degps: float = 10.0
    input: InputRules = field(default_factory=InputRules)
    noise: FilterNoise = field(default_factory=FilterNoise)

    def __post_init__(self):
        require_positive(self)
