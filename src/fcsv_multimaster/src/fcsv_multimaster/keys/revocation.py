# SPDX-License-Identifier: Apache-2.0
"""Which keys of a fleet are no longer good: a list that the fleet's authority signs and every
machine has a copy of.

Zenoh lets peers in by the common name of their certificate and reads no list of serial numbers. So
the common name counts: the first keys of ``uav1`` are ``uav1``, those made after these were revoked
``uav1.2``, and so on. A relay lets in one of them, the one after the last that was revoked.
"""

import base64
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, Tuple

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec

from fcsv_multimaster.errors import KeyringError

FILE = "revoked.json"


@dataclass(frozen=True)
class Revoked:
    """``last``: name of a machine to the number of its last revoked keys.

    >>> Revoked({"uav1": 1}).good_name("uav1"), Revoked({"uav1": 1}).good_name("uav2")
    ('uav1.2', 'uav2')
    >>> Revoked({"uav1": 1}).revokes("uav1"), Revoked({"uav1": 1}).revokes("uav1.2")
    (True, False)
    """

    last: Dict[str, int] = field(default_factory=dict)

    def good_name(self, machine: str) -> str:
        """The common name of the one certificate of ``machine`` that is let in."""
        number = self.last.get(machine, 0) + 1
        return machine if number == 1 else f"{machine}.{number}"

    def revokes(self, common_name: str) -> bool:
        machine, number = machine_of(common_name)
        return number <= self.last.get(machine, 0)


def machine_of(common_name: str) -> Tuple[str, int]:
    """(machine, number of its keys) of a certificate.

    >>> machine_of("uav1"), machine_of("uav1.3")
    (('uav1', 1), ('uav1', 3))
    """
    machine, _, number = common_name.partition(".")
    return machine, int(number) if number.isdigit() else 1


def write_revoked(path: Path, revoked: Revoked, authority_key) -> None:
    signature = authority_key.sign(_signed(revoked.last), ec.ECDSA(hashes.SHA256()))
    document = {"revoked": revoked.last, "signature": base64.b64encode(signature).decode()}
    path.write_text(json.dumps(document, indent=1, sort_keys=True) + "\n")


def read_revoked(path: Path, authority) -> Revoked:
    """The list beside a machine's keys; empty where there is none. Raises KeyringError, also on a
    foreign signature."""
    try:
        document = json.loads(path.read_text())
        last = {str(name): int(number) for name, number in document["revoked"].items()}
        signature = base64.b64decode(document["signature"])
        authority.public_key().verify(signature, _signed(last), ec.ECDSA(hashes.SHA256()))
    except FileNotFoundError:
        return Revoked()
    except InvalidSignature as error:
        raise KeyringError(
            f"{path}: was not signed by this fleet; copy it again from the fleet's folder"
        ) from error
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise KeyringError(
            f"{path}: is no list of revoked keys ({error!r}); copy it again"
        ) from error
    return Revoked(last)


def _signed(last: Dict[str, int]) -> bytes:
    return b"fcsv revoked keys " + json.dumps(last, sort_keys=True).encode()
