# SPDX-License-Identifier: Apache-2.0
"""Keys of a fleet: one authority, and per machine a key and a certificate that carries the machine's name."""

import datetime
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Sequence

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.backends import default_backend
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from fcsv_multimaster.errors import KeyringError

AUTHORITY = "fleet"
_AUTHORITY_KEY, _AUTHORITY_CERTIFICATE = "fleet.key", "fleet.pem"
_BACKEND = default_backend()  # the cryptography of Ubuntu 20.04 wants it named
_CLOCK_SLACK = datetime.timedelta(days=2)  # the clock of a vehicle without a clock battery may be far behind


@dataclass(frozen=True)
class Keyring:
    """What one machine needs: the authority's certificate, its own certificate and key (paths)."""

    authority: Path
    certificate: Path
    key: Path


def make_fleet(folder, names: Sequence[str], days: int = 3650) -> Sequence[Path]:
    """Write fleet.key, fleet.pem (kept where they exist) and a folder per machine; the folders.

    Copy NAME/ to the machine NAME; fleet.key stays at home. A name that has its keys already keeps them.
    Raises KeyringError.
    """
    folder = Path(folder)
    for name in names:
        if not name.isidentifier() or name == AUTHORITY:
            raise KeyringError(f"'{name}' cannot be a machine's name; use letters, digits and _")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        authority_key, authority = _authority(folder, days)
        return [_machine(folder / name, name, authority_key, authority, days) for name in names]
    except OSError as error:
        raise KeyringError(f"{error.filename}: cannot be written ({error.strerror})") from error


def open_keyring(folder, name: str) -> Keyring:
    """The keys of the machine ``name``, checked: there, its own, signed by the fleet, not out of date.

    Raises KeyringError naming the file.
    """
    folder = Path(folder)
    ring = Keyring(folder / _AUTHORITY_CERTIFICATE, folder / "machine.pem", folder / "machine.key")
    for path in (ring.authority, ring.certificate, ring.key):
        if not path.is_file():
            raise KeyringError(
                f"{path}: is missing; make keys with `rosrun fcsv_multimaster keys FOLDER {name} ...`"
                f" and copy FOLDER/{name} here"
            )
    authority, certificate = _read_certificate(ring.authority), _read_certificate(ring.certificate)
    if _common_name(certificate) != name:
        raise KeyringError(f"{ring.certificate}: belongs to '{_common_name(certificate)}', this machine is '{name}'")
    try:
        authority.public_key().verify(
            certificate.signature, certificate.tbs_certificate_bytes, ec.ECDSA(certificate.signature_hash_algorithm)
        )
    except InvalidSignature as error:
        raise KeyringError(f"{ring.certificate}: is not of the fleet of {ring.authority}") from error
    if certificate.not_valid_after < datetime.datetime.utcnow():
        raise KeyringError(f"{ring.certificate}: ran out on {certificate.not_valid_after:%Y-%m-%d}; make new keys")
    if _public(_read_key(ring.key)) != _public(certificate):
        raise KeyringError(f"{ring.key}: is not the key of {ring.certificate.name}")
    return ring


def _authority(folder: Path, days: int):
    key_path, certificate_path = folder / _AUTHORITY_KEY, folder / _AUTHORITY_CERTIFICATE
    if key_path.exists():
        return _read_key(key_path), _read_certificate(certificate_path)
    key = ec.generate_private_key(ec.SECP256R1(), _BACKEND)
    builder = _builder(AUTHORITY, AUTHORITY, key.public_key(), days)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    certificate = builder.sign(key, hashes.SHA256(), _BACKEND)
    _write_key(key_path, key)
    _write_certificate(certificate_path, certificate)
    return key, certificate


def _machine(folder: Path, name: str, authority_key, authority, days: int) -> Path:
    if (folder / "machine.key").exists():
        return folder
    folder.mkdir(mode=0o700, exist_ok=True)
    key = ec.generate_private_key(ec.SECP256R1(), _BACKEND)
    usages = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    builder = _builder(name, AUTHORITY, key.public_key(), days)
    builder = builder.add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    certificate = builder.add_extension(usages, critical=False).sign(authority_key, hashes.SHA256(), _BACKEND)
    _write_certificate(folder / _AUTHORITY_CERTIFICATE, authority)
    _write_certificate(folder / "machine.pem", certificate)
    _write_key(folder / "machine.key", key)
    return folder


def _builder(subject: str, issuer: str, public_key, days: int) -> x509.CertificateBuilder:
    now = datetime.datetime.utcnow()
    return (
        x509.CertificateBuilder()
        .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, subject)]))
        .issuer_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, issuer)]))
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCK_SLACK)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _write_key(path: Path, key) -> None:
    data = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(data)


def _write_certificate(path: Path, certificate: x509.Certificate) -> None:
    path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def _read_key(path: Path):
    try:
        return serialization.load_pem_private_key(path.read_bytes(), None, _BACKEND)
    except (OSError, ValueError, TypeError) as error:
        raise KeyringError(f"{path}: is not a readable key ({error})") from error


def _read_certificate(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes(), _BACKEND)
    except (OSError, ValueError) as error:
        raise KeyringError(f"{path}: is not a readable certificate ({error})") from error


def _common_name(certificate: x509.Certificate) -> str:
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return names[0].value if names else ""


def _public(holder) -> bytes:
    return holder.public_key().public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo)
