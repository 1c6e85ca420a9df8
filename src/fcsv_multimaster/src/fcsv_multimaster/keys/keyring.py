# SPDX-License-Identifier: Apache-2.0
"""Keys of a fleet: one authority, and per machine a key and a certificate that carries the
machine's name."""

import datetime
from dataclasses import dataclass, field
from pathlib import Path
from typing import Sequence

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec

from fcsv_multimaster.errors import KeyringError
from fcsv_multimaster.keys.certificates import (
    authority_certificate,
    common_name_of,
    machine_certificate,
    new_key,
    public_octets,
    read_certificate,
    read_key,
    write_certificate,
    write_key,
)
from fcsv_multimaster.keys.revocation import FILE as _REVOKED
from fcsv_multimaster.keys.revocation import Revoked, machine_of, read_revoked, write_revoked

AUTHORITY = "fleet"
WARN_BEFORE = datetime.timedelta(days=30)
_AUTHORITY_KEY, _AUTHORITY_CERTIFICATE = "fleet.key", "fleet.pem"
_CERTIFICATE, _KEY = "machine.pem", "machine.key"


@dataclass(frozen=True)
class Keyring:
    """What one machine needs: the authority's certificate, its own certificate and key (paths).

    ``runs_out``: when the first of the two certificates does (UTC); ``fleet_too``: the authority's
    soon after, too.
    """

    authority: Path
    certificate: Path
    key: Path
    runs_out: datetime.datetime = datetime.datetime.max
    fleet_too: bool = False
    revoked: Revoked = field(default_factory=Revoked)

    def warning(self, now: datetime.datetime) -> str:
        """What is to be said before they run out; empty while there is time."""
        if self.runs_out - now > WARN_BEFORE:
            return ""
        days = max(0, (self.runs_out - now).days)
        remedy = (
            "all machines need keys from a new folder"
            if self.fleet_too
            else "make new ones and copy them here"
        )
        return f"the keys run out on {self.runs_out:%Y-%m-%d}, in {days} days; {remedy}"


def make_fleet(folder, names: Sequence[str], days: int = 3650) -> Sequence[Path]:
    """Write fleet.key, fleet.pem (kept where they exist) and a folder per machine; the folders.

    Copy NAME/ to the machine NAME; fleet.key stays at home. A name that has its keys already keeps
    them, unless they are revoked or run out within 30 days. Raises KeyringError.
    """
    folder = Path(folder)
    for name in names:
        if not name.isidentifier() or name == AUTHORITY:
            raise KeyringError(f"'{name}' cannot be a machine's name; use letters, digits and _")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        authority_key, authority = _authority(folder, days)
        revoked = read_revoked(folder / _REVOKED, authority)
        made = [
            _machine(folder / name, name, authority_key, authority, revoked, days) for name in names
        ]
        _spread(folder, revoked, authority_key)
        return made
    except OSError as error:
        raise KeyringError(f"{error.filename}: cannot be written ({error.strerror})") from error


def revoke(folder, names: Sequence[str]) -> Sequence[Path]:
    """Put the present keys of machines on the list of revoked ones; the lists that are to be
    copied.

    Raises KeyringError.
    """
    folder = Path(folder)
    if not (folder / _AUTHORITY_KEY).exists():
        raise KeyringError(
            f"{folder}: has no {_AUTHORITY_KEY}; give the folder in which the keys were made"
        )
    authority_key, authority = _authority(folder, 1)
    last = dict(read_revoked(folder / _REVOKED, authority).last)
    for name in names:
        certificate = folder / name / _CERTIFICATE
        if not certificate.is_file():
            raise KeyringError(f"{certificate}: is missing; '{name}' has no keys of this fleet")
        number = machine_of(common_name_of(read_certificate(certificate)))[1]
        if number <= last.get(name, 0):
            raise KeyringError(f"{certificate}: is revoked already")
        last[name] = number
    return _spread(folder, Revoked(last), authority_key)


def open_keyring(folder, name: str) -> Keyring:
    """The keys of the machine ``name``, checked: there, its own and nobody else's, good, and not
    revoked.

    Raises KeyringError naming the file.
    """
    folder = Path(folder)
    paths = [folder / _AUTHORITY_CERTIFICATE, folder / _CERTIFICATE, folder / _KEY]
    for path in paths:
        if not path.is_file():
            raise KeyringError(
                f"{path}: is missing; make keys with `rosrun fcsv_multimaster keys FOLDER {name} ...`"
                f" and copy FOLDER/{name} here"
            )
    authority, certificate = read_certificate(paths[0]), read_certificate(paths[1])
    common_name = common_name_of(certificate)
    if machine_of(common_name)[0] != name:
        raise KeyringError(f"{paths[1]}: belongs to '{common_name}', this machine is '{name}'")
    try:
        authority.public_key().verify(
            certificate.signature,
            certificate.tbs_certificate_bytes,
            ec.ECDSA(certificate.signature_hash_algorithm),
        )
    except InvalidSignature as error:
        raise KeyringError(f"{paths[1]}: is not of the fleet of {paths[0]}") from error
    runs_out = min(authority.not_valid_after, certificate.not_valid_after)
    if runs_out < datetime.datetime.utcnow():
        raise KeyringError(f"{paths[1]}: ran out on {runs_out:%Y-%m-%d}; make new keys")
    if public_octets(read_key(paths[2])) != public_octets(certificate):
        raise KeyringError(f"{paths[2]}: is not the key of {paths[1].name}")
    revoked = read_revoked(folder / _REVOKED, authority)
    if revoked.revokes(common_name):
        raise KeyringError(f"{paths[1]}: is revoked; make new keys for {name} and copy them here")
    return Keyring(*paths, runs_out, authority.not_valid_after < runs_out + WARN_BEFORE, revoked)


def _authority(folder: Path, days: int):
    key_path, certificate_path = folder / _AUTHORITY_KEY, folder / _AUTHORITY_CERTIFICATE
    if key_path.exists():
        return read_key(key_path), read_certificate(certificate_path)
    key = new_key()
    certificate = authority_certificate(AUTHORITY, key, days)
    write_key(key_path, key)
    write_certificate(certificate_path, certificate)
    return key, certificate


def _machine(
    folder: Path, name: str, authority_key, authority, revoked: Revoked, days: int
) -> Path:
    if (folder / _KEY).exists() and _lasts(read_certificate(folder / _CERTIFICATE), revoked):
        return folder
    folder.mkdir(mode=0o700, exist_ok=True)
    key = new_key()
    certificate = machine_certificate(
        revoked.good_name(name), name, key, authority, authority_key, days
    )
    write_certificate(folder / _AUTHORITY_CERTIFICATE, authority)
    write_certificate(folder / _CERTIFICATE, certificate)
    write_key(folder / _KEY, key)
    return folder


def _lasts(certificate: x509.Certificate, revoked: Revoked) -> bool:
    soon = datetime.datetime.utcnow() + WARN_BEFORE
    return certificate.not_valid_after > soon and not revoked.revokes(common_name_of(certificate))


def _spread(folder: Path, revoked: Revoked, authority_key) -> Sequence[Path]:
    """The list, signed, in the fleet's folder and in every machine's; the latter."""
    machines = sorted(path.parent for path in folder.glob(f"*/{_CERTIFICATE}"))
    for place in (folder, *machines):
        write_revoked(place / _REVOKED, revoked, authority_key)
    return [place / _REVOKED for place in machines]
