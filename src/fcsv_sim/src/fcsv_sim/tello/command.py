# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello as a program of its own, without ROS: its voice is its protocol."""

import argparse
import signal
import sys
import threading

from fcsv_geometry.errors import FcsvError
from fcsv_sim.tello.battery import BatteryRules
from fcsv_sim.tello.drone import DroneParameters
from fcsv_sim.tello.pictures import SimulatedVideoParameters
from fcsv_sim.tello.program import ProgramParameters, switched_on, words
from fcsv_sim.tello.radio import WifiParameters
from fcsv_sim.tello.udp import ADDRESS, PORT, run


def _arguments(argv) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tello_alone", description=__doc__)
    parser.add_argument("--name", default="tello1", help="of its truth file")
    parser.add_argument(
        "--sim-dir", default="/tmp/fcsv_sim", help="folder in which simulated things meet"
    )
    parser.add_argument(
        "--network",
        default="",
        metavar="NAME",
        help=(
            "it is in network namespace NAME-device, who flies it in NAME-pilot; both are made "
            "where they are not there "
            "(root); empty: the address is one of this machine"
        ),
    )
    parser.add_argument("--address", default=ADDRESS, help="where it listens (%(default)s)")
    parser.add_argument("--port", type=int, default=PORT)
    parser.add_argument(
        "--video-port", type=int, default=0, help="of pictures; 0: the one that the client names"
    )
    parser.add_argument("--start", default="0,0,0,0", help="x, y, z (m), yaw (rad)")
    parser.add_argument("--battery", type=float, default=95.0, help="percent at the start")
    parser.add_argument(
        "--loss", type=float, default=WifiParameters.loss, help="share of lost packets, each way"
    )
    parser.add_argument(
        "--other-firmware", action="store_true", help="its messages (docs/design/trackers.md)"
    )
    parser.add_argument(
        "--world", default="", help="of its video: street, village, field, plain; empty: no video"
    )
    parser.add_argument(
        "--vehicles-dir", default="config/vehicles", help="where NAME.yaml says how its camera sits"
    )
    parser.add_argument(
        "--video-hz", type=float, default=SimulatedVideoParameters.rate_hz, help="pictures a second"
    )
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args(argv)


def _parameters(args: argparse.Namespace) -> ProgramParameters:
    """Raises ValueError."""
    start = tuple(float(word) for word in args.start.split(","))
    if len(start) != 4:
        raise ValueError(f"--start: '{args.start}' must be x,y,z,yaw")
    video = SimulatedVideoParameters(
        args.world, vehicles_dir=args.vehicles_dir, rate_hz=args.video_hz
    )
    return ProgramParameters(
        args.name,
        args.sim_dir,
        args.seed,
        start,
        battery=BatteryRules(args.battery),
        radio=WifiParameters(loss=args.loss),
        drone=DroneParameters(other_firmware=args.other_firmware),
        network=args.network,
        address=args.address,
        port=args.port,
        video_port=args.video_port,
        video=video,
    )


def main(argv=None) -> int:
    """Runs until SIGINT or SIGTERM. Exit status 2 where it cannot run."""
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    try:
        parameters = _parameters(_arguments(argv))
        with switched_on(parameters) as shell:
            print(words(parameters), flush=True)
            run(shell, over.is_set)
    except (FcsvError, ValueError) as error:
        print(f"tello_alone: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
