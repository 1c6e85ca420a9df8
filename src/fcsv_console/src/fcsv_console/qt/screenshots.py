# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_console screenshots: pictures of the window in each of its states, for
docs/user/console.md."""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Optional, Sequence, Tuple

from fcsv_console.model import samples
from fcsv_geometry.programs.workspace import bringup

_ROUNDS = 5  # until everything has its size
#: file, situation, theme, size (px)
PICTURES = (
    ("starting", "starting", "light", (1366, 740)),
    ("ground", "ground", "light", (1366, 740)),
    ("calibrated", "calibrated", "dark", (1366, 740)),
    ("ready", "ready", "light", (1366, 740)),
    ("flying", "flying", "dark", (1366, 740)),
    ("pictures", "pictures", "dark", (1366, 740)),
    ("indoors", "indoors", "light", (1366, 740)),
    ("robot", "robot", "light", (1366, 740)),
    ("wrong", "wrong", "dark", (1366, 740)),
    ("silent", "silent", "light", (1366, 740)),
    ("landed", "landed", "light", (1366, 740)),
    ("error", "error", "light", (1366, 740)),
    ("small", "flying", "light", (960, 540)),
    ("small_landed", "landed", "light", (960, 540)),
)


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status: 0; 1 where a picture cannot be written."""
    parser = argparse.ArgumentParser(prog="screenshots", description=__doc__)
    parser.add_argument("out", type=Path, help="folder for the pictures")
    arguments = parser.parse_args(argv if argv is not None else sys.argv[1:])
    os.environ.setdefault(
        "QT_QPA_PLATFORM", "offscreen" if not os.environ.get("DISPLAY") else "xcb"
    )
    from fcsv_console.ros.window_command import application

    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        print(f"screenshots: {arguments.out}: {error.strerror}", file=sys.stderr)
        return 1
    for name, situation, theme, size in PICTURES:
        app = application(theme)
        window = made(situation, size)
        for _ in range(_ROUNDS):
            app.processEvents()
            time.sleep(0.01)
        path = arguments.out / f"console_{name}.png"
        if not window.grab().save(str(path)):
            print(f"screenshots: {path} cannot be written", file=sys.stderr)
            return 1
        window.end()
        print(path)
    return 0


def made(situation: str, size: Tuple[int, int]):
    """A shown window with a scripted situation; "error": a file that cannot be flown; "pictures":
    with them; "indoors": with cameras on the ground; "robot": with one that is guided."""
    from fcsv_console.qt.window import ConsoleWindow

    mission = bringup() / "config/missions/outdoor.yaml"
    console = samples.console(str(mission))
    samples.SAMPLES[
        {"error": "ready", "pictures": "flying", "indoors": "flying", "robot": "flying"}.get(
            situation, situation
        )
    ](console)
    if situation == "robot":
        samples.guided_robot(console)
    if situation == "indoors":
        samples.ground_cameras(console)
    if situation == "error":
        console.edit(console.file.text.replace("baseline_m: 6.0", "baseline_m: -6.0"))
    window = ConsoleWindow(console.view(samples.NOW_S))
    window.resize(*size)
    if situation == "error":
        window.mission._tabs.setCurrentIndex(1)
    window.show()
    if situation == "pictures":
        window.show_pictures.click()
    if situation == "landed":
        window.show_after.click()
    return window
