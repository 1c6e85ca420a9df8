# SPDX-License-Identifier: Apache-2.0
"""Errors of the relay."""

from fcsv_geometry.errors import FcsvError


class RelayError(FcsvError):
    """Base of all errors of this package."""


class EndpointError(RelayError):
    """An address or a peer that cannot be understood or opened."""


class ExposedError(RelayError):
    """ROS that is open to the network, past keys."""


class KeyringError(RelayError):
    """Keys that are missing, expired, revoked, open to others, or another machine's."""


class PictureError(RelayError):
    """A picture that cannot be packed or unpacked."""


class WireError(RelayError):
    """Bytes from a peer that this relay cannot read."""
