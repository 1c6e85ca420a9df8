# SPDX-License-Identifier: Apache-2.0
"""A program: the depth that vehicles which hold would publish on /map/watch, drawn, of a place with
a robot and a crate in it.

Arguments: the world's kind, its seed, home in the world (x, y, z, yaw), the file of the map that
they hold above (.npz of depth, sigma, kind, K, T_home_cam), the folder of true poses.
"""

import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import rospy

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.ros import node
from fcsv_guidance.ground.views import DepthView
from fcsv_sim.robot.things import Box, Watcher
from fcsv_sim.truth import TruthReader
from fcsv_sim.world.movers import CRATE, CRATE_HALF_M, ROBOT, ROBOT_HALF_M
from fcsv_sim.world.town import Town
from fcsv_stereo.ros.map_topics import MapTopics

PERIOD_S, LATE_S = 0.5, 0.3


def boxes(readers, stamp_s):
    """Robot and crate where they are."""
    found = []
    for reader, half_m in readers:
        try:
            T = reader.wait_for(stamp_s)
        except PoseUnavailable:
            continue
        if T[2, 3] > -10.0:
            found.append(Box(*T[:3, 3], half_m[:2], 2 * half_m[2], transforms.yaw(T)))
    return found


def main(world, seed, x, y, z, yaw, file, sim_dir):
    """Publishes until it is stopped."""
    node.begin("watching_vehicles")
    T_world_home = transforms.from_xyz_yaw([float(x), float(y), float(z)], float(yaw))
    stored = np.load(file)
    arrays = [stored[name] for name in ("depth", "sigma", "kind", "K")]
    view = DepthView("watch", *arrays, T_world_home @ stored["T_home_cam"])
    watcher, K = Watcher(Town.generate(int(seed), world), view, 3), arrays[3]
    height, width = view.depth.shape
    camera = PinholeCamera(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    readers = [
        (TruthReader(sim_dir, name), half_m)
        for name, half_m in ((ROBOT, ROBOT_HALF_M), (CRATE, CRATE_HALF_M))
    ]
    topics = MapTopics()
    while not rospy.is_shutdown():
        stamp_s = time.time()
        seen = watcher.look(stamp_s, boxes(readers, stamp_s - 0.05))
        seen = replace(seen, T_home_cam=stored["T_home_cam"])
        reference = SimpleNamespace(T_home_cam=seen.T_home_cam, stamp_s=stamp_s, camera=camera)
        result = SimpleNamespace(
            reference=reference, depth=seen.depth, sigma=seen.sigma, kind=seen.kind
        )
        time.sleep(max(0.0, stamp_s + LATE_S - time.time()))
        topics.publish_watch(result)
        time.sleep(max(0.0, stamp_s + PERIOD_S - time.time()))


if __name__ == "__main__":
    main(*sys.argv[1:9])
