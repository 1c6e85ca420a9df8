# SPDX-License-Identifier: Apache-2.0
"""What a user waits for photographs: ``fcsv map`` of a folder of them, report and all, in a process
of its own.

python -m bench.large FOLDER OUT     maps FOLDER into OUT; prints seconds and memory as JSON
"""

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Iterable, List, Tuple

import cv2
import numpy as np

from bench.growth import status_mib
from bench.scenes import NOISES, Baselines, SceneName, shoot
from fcsv_stereo.model import Cloud, ImageEntry, MapInput, MapResult, Picture, Reference
from fcsv_stereo.products.exchange import write_colmap

#: Width, height, by how much the drawn picture is enlarged to it, and pictures.
SETS = ((1280, 853, 1, 8), (6000, 4000, 4, 3))
_NOISE_GREY = 2.0


@dataclass(frozen=True)
class Waited:
    """For one set of pictures: ``pixels`` of each, by the clock and of the processor, and the
    process's peak."""

    pixels: int
    pictures: int
    seconds: float
    cpu_seconds: float
    memory_mib: float


def measure_large(quick: bool) -> List[Waited]:
    """All sets, the small ones first."""
    return [_measured(*each) for each in (SETS[:1] if quick else SETS)]


def large_table(found: Iterable[Waited]) -> List[str]:
    """A row a set."""
    lines = [
        "| pictures | waited | of the processor | peak memory | of the processor, per megapixel and picture | memory |",
        "|---|---|---|---|---|---|",
    ]
    for w in found:
        share = w.pixels / 1e6 * w.pictures
        lines.append(
            f"| {w.pictures} of {w.pixels / 1e6:.1f} megapixels | {w.seconds:.0f} s | {w.cpu_seconds:.0f} s | "
            f"{w.memory_mib / 1024:.1f} GiB | {w.cpu_seconds / share:.1f} s | {w.memory_mib / share:.0f} MiB |"
        )
    return lines


def _measured(width: int, height: int, enlarged: int, pictures: int) -> Waited:
    baselines: Baselines = [("horizontal", float(b)) for b in np.linspace(1.0, 8.0, pictures)[1:]]
    scene = shoot(SceneName("street", 1), baselines, (width // enlarged, height // enlarged))
    given = scene.given(baselines, NOISES[0])
    with tempfile.TemporaryDirectory() as folder:
        write_photographs(given, enlarged, Path(folder) / "photographs")
        command = [sys.executable, "-m", "bench.large", f"{folder}/photographs", f"{folder}/map"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = Waited(width * height, pictures, *json.loads(done.stdout.strip().splitlines()[-1]))
    print(f"    {pictures} of {width}x{height}: {found}", flush=True)
    return found


def write_photographs(given: MapInput, enlarged: int, folder: Path) -> None:
    """The pictures ``enlarged`` times, with the noise of a sensor, and their poses, as COLMAP's
    text model."""
    first = given.configurations[0].references[0]
    pictures = [
        _enlarged(p, enlarged) for p in (first, *(c.others[0] for c in given.configurations))
    ]
    entries = [ImageEntry(p.name, p.vehicle, 0.0, p.T_home_cam, p.T_home_cam) for p in pictures]
    configurations = [
        replace(c, references=[pictures[0]], others=[p])
        for c, p in zip(given.configurations, pictures[1:])
    ]
    nothing = Cloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    depth = np.zeros((1, 1), np.float32)
    result = MapResult("none", Reference.of(pictures[0]), entries, [], depth, depth, nothing)
    write_colmap(result, replace(given, configurations=configurations), nothing, folder)


def _enlarged(p: Picture, times: int) -> Picture:
    if times == 1:
        return p
    height, width = (n * times for n in p.image.shape[:2])
    image = cv2.resize(p.image, (width, height), interpolation=cv2.INTER_CUBIC).astype(np.float32)
    image += (
        np.random.default_rng(len(p.name)).normal(0.0, _NOISE_GREY, image.shape).astype(np.float32)
    )
    return replace(
        p, image=np.clip(image, 0.0, 255.0).astype(np.uint8), camera=p.camera.resized(width, height)
    )


def _child(folder: str, out: str) -> Tuple[float, float, float]:
    from fcsv_stereo import cli

    started = time.perf_counter()
    if cli.main([folder, "-o", out]) != 0:
        raise SystemExit(1)
    return time.perf_counter() - started, time.process_time(), status_mib("VmHWM")


if __name__ == "__main__":
    print(json.dumps(_child(*sys.argv[1:3])))
