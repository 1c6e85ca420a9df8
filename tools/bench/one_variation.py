# SPDX-License-Identifier: Apache-2.0
"""The bench's scenes mapped with tuned numbers changed: the process that ``tuned-numbers`` starts for
each variation.

    python -m bench.one_variation FOLDER '{"noise": 0, "stage": ..., "values": {NUMBER: VALUE}}'

It prints ``{scene: [within 10 %, wrong of answered, within 2 sigma, seconds of the processor]}``.
"""

import importlib.util
import json
import pickle
import sys
from pathlib import Path
from typing import Any, Dict, List


def main(folder: Path, one: Dict[str, Any]) -> Dict[str, List[float]]:
    """Figures by scene, in points; a scene that is refused scores nothing."""
    _set_before_joint(one)
    # imported now: modules of joint freeze the numbers when they are imported
    from bench.measure import figures, run
    from bench.scenes import LISTS, NOISES, SCENES, PoseNoise
    from bench.tuned_numbers import LIST
    from fcsv_stereo.errors import StereoError

    # a second draw of the same noise: its seed follows from the rotation in microradians
    again = PoseNoise(NOISES[0].rotation_rad + 2e-6, NOISES[0].share)
    rows = {}
    for name in SCENES:
        scene = pickle.loads((folder / f"{name}.pickle").read_bytes())
        given = scene.given(LISTS[LIST], (NOISES[0], again)[one["noise"]])
        try:
            result, seconds, cpu_seconds = run("joint", given)
        except StereoError:
            rows[str(name)] = [0.0, 100.0, 0.0, 0.0]
            continue
        f = figures(result, scene, seconds, cpu_seconds)
        shares = (f.within_10, f.wrong_of_answered, f.within_2_sigma)
        rows[str(name)] = [*(round(100.0 * s, 4) for s in shares), round(cpu_seconds, 3)]
    return rows


def _set_before_joint(one: Dict[str, Any]) -> None:
    """Puts the values into their stage while nothing of ``joint`` but ``joint.tuning`` is imported."""
    spec = importlib.util.find_spec("fcsv_stereo.joint")
    package = importlib.util.module_from_spec(spec)
    sys.modules["fcsv_stereo.joint"] = package  # known, but its own imports wait
    tuning = importlib.import_module("fcsv_stereo.joint.tuning")
    early = [m for m in sys.modules if m.startswith("fcsv_stereo.joint.") and ".tuning" not in m]
    if early:
        raise RuntimeError(f"imported before the number was set: {', '.join(sorted(early))}")
    for number, value in one.get("values", {}).items():
        owner = next(s for s in tuning.STAGES if type(s).__name__ == one["stage"])
        object.__setattr__(owner, number, tuple(value) if isinstance(value, list) else value)
    spec.loader.exec_module(package)


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]), json.loads(sys.argv[2]))))
