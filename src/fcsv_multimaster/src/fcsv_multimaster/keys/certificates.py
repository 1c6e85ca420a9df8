# SPDX-License-Identifier: Apache-2.0
"""Certificates and keys of a fleet as files: made, signed, written, read."""

import datetime
import os
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.backends import default_backend
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from fcsv_multimaster.errors import KeyringError

_BACKEND = default_backend()  # the cryptography of Ubuntu 20.04 wants it named
# the clock of a vehicle without a clock battery may be far behind
_CLOCK_SLACK = datetime.timedelta(days=2)
_OTHERS = 0o077  # the bits of a file's mode that let anybody but its owner at it


def new_key():
    return ec.generate_private_key(ec.SECP256R1(), _BACKEND)


def authority_certificate(name: str, key, days: int) -> x509.Certificate:
    """Makes the certificate of the fleet, signed by itself."""
    builder = _builder(name, name, key.public_key(), days)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    return builder.sign(key, hashes.SHA256(), _BACKEND)


def machine_certificate(
    common_name: str, host: str, key, authority: x509.Certificate, authority_key, days: int
):
    """Makes the certificate of a machine, signed by the fleet."""
    usages = x509.ExtendedKeyUsage(
        [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    )
    builder = _builder(common_name, common_name_of(authority), key.public_key(), days)
    builder = builder.add_extension(
        x509.SubjectAlternativeName([x509.DNSName(host)]), critical=False
    )
    builder = builder.add_extension(
        x509.BasicConstraints(ca=False, path_length=None), critical=True
    )
    return builder.add_extension(usages, critical=False).sign(
        authority_key, hashes.SHA256(), _BACKEND
    )


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


def write_key(path: Path, key) -> None:
    """Writes the key in place of what stands there; nobody but the owner may read it."""
    data = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    if path.exists():
        path.unlink()
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(data)


def write_certificate(path: Path, certificate: x509.Certificate) -> None:
    path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def read_key(path: Path):
    """Raises KeyringError, also where others than its owner may read or change the file."""
    try:
        mode = path.stat().st_mode & 0o777
        if mode & _OTHERS:
            raise KeyringError(
                f"{path}: others may read it (mode {mode:04o}); `chmod 600 {path}`, and make new keys where"
                " somebody may have copied it"
            )
        return serialization.load_pem_private_key(path.read_bytes(), None, _BACKEND)
    except (OSError, ValueError, TypeError) as error:
        raise KeyringError(f"{path}: is not a readable key ({error})") from error


def read_certificate(path: Path) -> x509.Certificate:
    """Raises KeyringError."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes(), _BACKEND)
    except (OSError, ValueError) as error:
        raise KeyringError(f"{path}: is not a readable certificate ({error})") from error


def common_name_of(certificate: x509.Certificate) -> str:
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return names[0].value if names else ""


def public_octets(holder) -> bytes:
    """Gives the public octets of a key or a certificate; equal where they belong together."""
    return holder.public_key().public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )
