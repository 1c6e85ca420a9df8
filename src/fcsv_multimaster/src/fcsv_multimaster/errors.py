# SPDX-License-Identifier: Apache-2.0
"""Errors of the relay."""

from fcsv_geometry.errors import FcsvError


class RelayError(FcsvError):
    """Base of all errors of this package."""


class EndpointError(RelayError):
    """An address or a peer that cannot be understood or opened."""
