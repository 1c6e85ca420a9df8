# SPDX-License-Identifier: Apache-2.0
"""What maps of simulated Tellos lack, by cause: of flown demos (make demo SYSTEM=tello, mocap or gimbal)
the map of the pictures as recorded, and of the same ones rendered anew where they were truly taken: as the Tello does,
with its video's compression; without it; and without it, with smooth edges. Poses are the recorded ones.

    python tools/tello_pictures.py --seed 1 out/demo [FOLDER ...]
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import List

import av
import numpy as np

from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import SimulatedCamera
from fcsv_sim.tello.encoder import Encoder
from fcsv_sim.tello.pictures import VideoParameters
from fcsv_sim.world.town import Town
from fcsv_stereo.evaluation import BANDS_M, evaluate
from fcsv_stereo.joint import JointOptions
from fcsv_stereo.model import MapInput, Picture, silent
from fcsv_stereo.model.kinds import Kind
from fcsv_stereo.pipeline import METHODS, load
from fcsv_stereo.truth import TrueScene, Truth, load_truth

#: In words: rays per pixel where surfaces meet, and whether it is compressed.
PICTURES = {"rendered, compressed": (1, True), "rendered": (1, False), "rendered, smooth edges": (5, False)}
_CAMERA = replace(VideoParameters().camera, mount_deg=0.0)  # the true pose has what shook it
_BIT_PER_S, _RATE_HZ = 2e6, 2.0
_SETTLED_S = 10.0  # the exposure has followed by then
_GIVEN_UP = {"outside": Kind.OUTSIDE, "hidden": Kind.HIDDEN, "blank": Kind.BLANK}  # of pixels up to 50 m


class Again:
    """Pictures of a town, anew from where they were truly taken."""

    def __init__(self, truth: Truth, town: Town, samples: int, compressed: bool):
        self._truth, self._renderer, self._samples, self._compressed = truth, Renderer(town), samples, compressed

    def picture(self, p: Picture) -> Picture:
        """The same with other pixels; where it flies beside others, without these."""
        T_world_cam = self._truth.T_world_cam(p.vehicle, p.stamp_s)
        camera = SimulatedCamera(self._renderer, np.eye(4), _CAMERA, round(p.stamp_s * 1e3) % 100_000)
        camera.shoot(p.stamp_s - _SETTLED_S, T_world_cam, samples=1)  # its exposure
        rgb = camera.shoot(p.stamp_s, T_world_cam, samples=self._samples).rgb
        rgb = compressed(rgb) if self._compressed else rgb
        return Picture.undistorted(p.name, p.vehicle, p.stamp_s, rgb, _CAMERA.model, p.T_home_cam, p.covariance)


def compressed(rgb: np.ndarray) -> np.ndarray:
    """The third picture (H,W,3 uint8) of a Tello's stream that shows the same all the time."""
    encoder, decoder = Encoder(_CAMERA.width, _CAMERA.height, _RATE_HZ), av.CodecContext.create("h264", "r")
    frames = [f for k in range(3) for f in decoder.decode(av.Packet(encoder.encode(rgb, _BIT_PER_S, k == 0)))]
    return [*frames, *decoder.decode(None)][-1].to_ndarray(format="rgb24")


def mapped_only(given: MapInput, folder: Path) -> MapInput:
    """Of the recordings the pictures that the folder's map was made of."""
    document = json.loads((folder / "map" / "report.json").read_text())
    used = {document["reference"]["image"], *(i["name"] for i in document["images"])}

    def only(pictures: List[Picture]) -> List[Picture]:
        return [p for p in pictures if p.name in used] or pictures[:1]

    return replace(given, configurations=[
        replace(c, references=only(c.references), others=only(c.others)) for c in given.configurations
    ])  # fmt: skip


def line(words: str, given: MapInput, truth: Truth) -> str:
    """A row of the table."""
    result = METHODS["joint"].map(given, JointOptions(), silent)
    r = result.reference
    true_depth = TrueScene(truth).depth(r.vehicle, r.stamp_s, r.camera)
    found, near = evaluate(result, truth, true_depth), true_depth <= 50.0
    shares = [*(b.within_10_percent for b in found.bands), found.overall.within_10_percent]
    lacks = [float((result.kind[near] == kind).mean()) for kind in _GIVEN_UP.values()]
    cells = [f"{100 * x:.1f} %" for x in (*shares, *lacks)]
    return f"| {words} | {' | '.join(cells)} | {found.overall.median_relative_error:.2%} |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--seed", type=int, default=1, help="of the flights: its town")
    parser.add_argument("--world", default="street")
    args = parser.parse_args()
    town = Town.generate(args.seed, args.world)
    heads = ("pictures", *(f"{a:g} to {b:g} m" for a, b in BANDS_M), "to 400 m", *_GIVEN_UP, "median error")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for folder in args.folders:
        truth = load_truth(folder / "session" / "truth")
        given = mapped_only(load(folder / "session"), folder)
        print(line(f"{folder.name}: as recorded", given, truth), flush=True)
        for words, (samples, is_compressed) in PICTURES.items():
            again = Again(truth, town, samples, is_compressed)
            others = [
                replace(
                    c, references=[again.picture(p) for p in c.references], others=[again.picture(p) for p in c.others]
                )
                for c in given.configurations
            ]
            print(line(words, replace(given, configurations=others), truth), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
