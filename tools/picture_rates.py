# SPDX-License-Identifier: Apache-2.0
"""How fast a flown session's cameras were while recording.

.venv/bin/python tools/picture_rates.py out/demo/session
"""

import argparse
from pathlib import Path

import numpy as np
import rosbag

_PAUSE_S = 1.0  # between two recordings


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path)
    for path in sorted(parser.parse_args().session.glob("*.bag")):
        with rosbag.Bag(str(path)) as bag:
            topics = [t for t in bag.get_type_and_topic_info().topics if t.endswith("image_raw")]
            if not topics:
                continue
            stamps = [m.header.stamp.to_sec() for _, m, _ in bag.read_messages(topics=topics)]
        steps = np.diff(stamps)
        steps = steps[steps < _PAUSE_S]
        if steps.size:
            slowest = np.percentile(steps, 90)
            print(
                f"{path.stem}: {len(stamps)} pictures, {1 / steps.mean():.2f} Hz, 90 % within {slowest:.3f} s"
            )


if __name__ == "__main__":
    main()
