# SPDX-License-Identifier: Apache-2.0
"""Time and memory of a method against picture size, pairs and depth steps; every run a process of
its own.

python -m bench.growth INPUT.pickle METHOD STEPS|-     prints seconds and memory as JSON
"""

import json
import pickle
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from bench.measure import run
from bench.scenes import HORIZONTAL, NOISES, SceneName, shoot, smaller
from fcsv_stereo.pipeline import METHODS

SIZES = ((640, 480), (1280, 960), (1920, 1440), (2560, 1440), (3840, 2160))
PAIRS = (1, 2, 4, 8, 16)
STEPS = (32, 64, 128, 256)
_SIXTEEN = [("horizontal", float(b)) for b in np.linspace(1.0, 8.5, 16)]


@dataclass(frozen=True)
class Sample:
    """``x`` of its series; memory is what the run added to the process at its peak (MiB)."""

    series: str
    method: str
    x: float
    seconds: float
    cpu_seconds: float
    memory_mib: float


def measure_growth(methods: List[str], quick: bool) -> List[Sample]:
    """All series; a method without depth steps is left out of that one."""
    samples = []
    for size in SIZES[:2] if quick else SIZES:
        given = shoot(SceneName("street", 1), HORIZONTAL[::2], size).given(
            HORIZONTAL[::2], NOISES[0]
        )
        samples += [_sample("size", m, size[0] * size[1] / 1e6, given, None) for m in methods]
    scene = shoot(SceneName("street", 1), _SIXTEEN)
    for pairs in PAIRS[:3] if quick else PAIRS:
        chosen = [_SIXTEEN[i] for i in np.unique(np.linspace(0, 15, pairs).astype(int))]
        samples += [
            _sample("pairs", m, pairs, scene.given(chosen, NOISES[0]), None) for m in methods
        ]
    given = scene.given(_SIXTEEN[1::4], NOISES[0])
    for steps in STEPS[:2] if quick else STEPS:
        able = [m for m in methods if _with_steps(m, steps) is not None]
        samples += [_sample("steps", m, steps, given, steps) for m in able]
    return [s for s in samples if s is not None]


def _with_steps(method: str, steps: int):
    """A method's own options with so many depth steps; None where it has none."""
    return METHODS[method].with_depth_steps(METHODS[method].options(), steps)


def _sample(series: str, method: str, x: float, given, steps: Optional[int]) -> Optional[Sample]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "input.pickle"
        path.write_bytes(pickle.dumps(given))
        command = [sys.executable, "-m", "bench.growth", str(path), method, str(steps or "-")]
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        print(
            f"    {method} at {series} {x:g} failed: {(done.stderr.strip().splitlines() or ['?'])[-1]}",
            flush=True,
        )
        return None
    found = json.loads(done.stdout.strip().splitlines()[-1])
    print(
        f"    {series} {x:g}, {method}: {found['seconds']:.1f} s, {found['memory_mib']:.0f} MiB",
        flush=True,
    )
    return Sample(series, method, x, found["seconds"], found["cpu_seconds"], found["memory_mib"])


def exponent(samples: List[Sample], value: str) -> Optional[float]:
    """Slope in log-log: 1 is linear, 0 constant."""
    x, y = (
        np.array([[s.x, max(getattr(s, value), 1e-3)] for s in samples]).T
        if len(samples) > 1
        else ([], [])
    )
    return float(np.polyfit(np.log(x), np.log(y), 1)[0]) if len(x) > 1 else None


def plot(samples: List[Sample], path: Path) -> None:
    """Processor time (a shared machine stretches the other) and memory over size, pairs, steps;
    grey: linear growth."""
    titles = {
        "size": "picture (megapixels), 2 pairs",
        "pairs": "pairs, 640x480",
        "steps": "depth steps, 4 pairs",
    }
    figure, axes = plt.subplots(2, 3, figsize=(12.5, 6.6))
    by_method: Dict[str, str] = {
        m: f"C{i}" for i, m in enumerate(sorted({s.method for s in samples}))
    }
    for column, (series, title) in enumerate(titles.items()):
        for row, (value, label) in enumerate(
            (("cpu_seconds", "s of the processor"), ("memory_mib", "MiB"))
        ):
            ax = axes[row, column]
            for method, color in by_method.items():
                mine = [s for s in samples if s.series == series and s.method == method]
                if mine:
                    x, y = (
                        np.array([s.x for s in mine]),
                        np.array([getattr(s, value) for s in mine]),
                    )
                    ax.plot(x, y, "o-", color=color, label=method)
                    ax.plot(x, y[0] * x / x[0], ":", color="#999999", lw=1)
            ax.set_xlabel(title)
            ax.set_ylabel(label)
            ax.set_xlim(left=0)
            ax.set_ylim(bottom=0)
            ax.grid(alpha=0.3)
    axes[0, 0].legend()
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _child(path: str, method: str, steps: str) -> None:
    """A warm-up on small pictures compiles; then the run that counts."""
    given = pickle.loads(Path(path).read_bytes())
    options = None if steps == "-" else _with_steps(method, int(steps))
    run(
        method,
        smaller(given, max(1, given.configurations[0].references[0].camera.width // 320)),
        options,
    )
    Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here on
    before_mib = status_mib("VmRSS")
    _, seconds, cpu_seconds = run(method, given, options)
    memory_mib = status_mib("VmHWM") - before_mib
    print(json.dumps({"seconds": seconds, "cpu_seconds": cpu_seconds, "memory_mib": memory_mib}))


def status_mib(key: str) -> float:
    """A figure of this process's memory (not getrusage's: its peak is that of whoever started the
    process)."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key + ":"):
            return int(line.split()[1]) / 1024.0
    raise OSError(f"/proc/self/status has no {key}")


if __name__ == "__main__":
    _child(*sys.argv[1:4])
