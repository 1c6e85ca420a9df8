# SPDX-License-Identifier: Apache-2.0
"""uav.launch with ArduCopter's own simulation, or what stands for it here, in the place of the
simulated autopilot."""

from contextlib import closing

import pytest
from support.copter_elsewhere import CopterElsewhere
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_sim.machines.machines import Machine, free_port
from fcsv_sim.truth import TruthReader

until = within(120.0)

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_uav_launch_flies_an_autopilot_elsewhere_by_one_argument(tmp_path):
    """Its flight link speaks with it, and the simulated tracker sees where it truly is, until the
    autopilot is fed."""
    copter = CopterElsewhere()
    with closing(copter), Machine("uav1", tmp_path) as machine:
        launch = machine.launch(
            "fcsv_bringup",
            "uav.launch",
            uav="uav1",
            sim=True,
            sim_dir=tmp_path / "sim",
            sim_autopilot=copter.url,
            record_dir=tmp_path / "session",
            listen=f"127.0.0.1:{free_port()}/{free_port()}",
            world="plain",
            sim_start="1.5,-2,0,0.5",
        )
        truth = TruthReader(tmp_path / "sim", "uav1")
        until(lambda: copter.fed or launch.returncode is not None, what=lambda: launch.tail(20))
        assert launch.returncode is None, launch.tail(20)
        T_world_body = truth.latest()[1]
        assert T_world_body == pytest.approx(
            transforms.from_xyz_yaw([1.5, -2.0, 0.0], 0.5), abs=0.05
        )
