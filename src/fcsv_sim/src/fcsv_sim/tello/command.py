# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello as a program of its own, without ROS: its voice is its protocol."""

import argparse
import contextlib
import signal
import sys
import threading
import time

from fcsv_geometry.errors import FcsvError
from fcsv_sim.machines import namespaces
from fcsv_sim.tello.battery import BatteryRules
from fcsv_sim.tello.radio import RadioParameters
from fcsv_sim.tello.udp import ADDRESS, PORT, Shell, open_socket, run
from fcsv_sim.tello.vehicle import TelloDrone, TelloDroneParameters


def _arguments(argv) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tello_drone", description=__doc__)
    parser.add_argument("--name", default="tello1", help="of its truth file")
    parser.add_argument("--sim-dir", default="/tmp/fcsv_sim", help="folder in which simulated things meet")
    parser.add_argument("--address", default=ADDRESS, help="where it listens (%(default)s)")
    parser.add_argument("--port", type=int, default=PORT)
    parser.add_argument("--namespace", default="", help="network namespace of its sockets; empty: where it is started")
    parser.add_argument("--start", default="0,0,0,0", help="x, y, z (m), yaw (rad)")
    parser.add_argument("--battery", type=float, default=95.0, help="percent at the start")
    parser.add_argument("--loss", type=float, default=RadioParameters.loss, help="share of lost packets, each way")
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args(argv)


def main(argv=None) -> int:
    """Until SIGINT or SIGTERM. Exit status 2 where it cannot run."""
    args = _arguments(argv)
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    try:
        start = tuple(float(word) for word in args.start.split(","))
        battery, radio = BatteryRules(args.battery), RadioParameters(loss=args.loss)
        parameters = TelloDroneParameters(args.name, args.sim_dir, args.seed, start, battery=battery, radio=radio)
        where = namespaces.inside(args.namespace) if args.namespace else contextlib.nullcontext()
        with where:
            control, video = open_socket(args.address, args.port), open_socket(args.address, 0)
    except (FcsvError, ValueError) as error:
        print(f"tello_drone: {error}", file=sys.stderr)
        return 2
    shell = Shell(TelloDrone(parameters, time.time()), control, video)
    print(f"{args.name}: listens on {args.address}:{args.port}", flush=True)
    run(shell, over.is_set)
    shell.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
