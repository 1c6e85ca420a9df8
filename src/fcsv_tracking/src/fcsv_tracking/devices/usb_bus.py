# SPDX-License-Identifier: Apache-2.0
"""Where the cameras sit on USB: two on one bus take each other's bandwidth and power, and a T265
then stops."""

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Sequence

_USB3_MBIT_S = 5000.0


@dataclass(frozen=True)
class UsbDevice:
    """``port``: the kernel's name of the place (bus-port.port...); ``kind``: vendor:product."""

    port: str
    kind: str
    speed_mbit_s: float

    @property
    def bus(self) -> str:
        return self.port.partition("-")[0]

    @property
    def hub(self) -> str:
        """The hub that it is plugged into: the bus itself, or a hub on it."""
        return self.port.rpartition(".")[0] or self.bus


def read_devices(folder) -> List[UsbDevice]:
    """Reads the devices of Linux's /sys/bus/usb/devices; what vanishes while it is read is left
    out."""
    out = []
    for place in sorted(Path(folder).glob("[0-9]*-*")):
        if ":" in place.name:
            continue
        try:
            vendor, product, speed = (
                (place / n).read_text().strip() for n in ("idVendor", "idProduct", "speed")
            )
            out.append(UsbDevice(place.name, f"{vendor}:{product}", float(speed)))
        except (OSError, ValueError):
            continue
    return out


def findings(devices: Sequence[UsbDevice], wanted: Dict[str, Sequence[str]]) -> Dict[str, str]:
    """Name of a device to what is wrong with its place. ``wanted``: name to its kinds; none: not on
    USB.

    >>> findings([UsbDevice("2-1.1", "a:1", 5000.0), UsbDevice("2-1.2", "b:2", 480.0)], {"cam": ["a:1"], "t": ["b:2"]})
    {'cam': 'shares hub 2-1 with t', 't': 'shares hub 2-1 with cam; runs at 480 Mbit/s, not as USB 3'}
    """
    here = {
        name: [d for d in devices if d.kind in kinds] for name, kinds in wanted.items() if kinds
    }
    out: Dict[str, str] = {}
    for name, mine in here.items():
        said = [] if mine else ["is not on USB"]
        others = [(n, d) for n, ds in here.items() if n != name for d in ds]
        for other, its in others:
            if any(d.hub == its.hub for d in mine) and its.hub != its.bus:
                said.append(f"shares hub {its.hub} with {other}")
            elif any(d.bus == its.bus for d in mine):
                said.append(f"shares USB bus {its.bus} with {other}")
        said += [
            f"runs at {d.speed_mbit_s:.0f} Mbit/s, not as USB 3"
            for d in mine
            if d.speed_mbit_s < _USB3_MBIT_S
        ]
        if said:
            out[name] = "; ".join(dict.fromkeys(said))
    return out
