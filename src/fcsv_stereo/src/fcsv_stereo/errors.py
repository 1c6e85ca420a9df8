# SPDX-License-Identifier: Apache-2.0
"""Errors of stereo: one line that names file, field and remedy."""

from fcsv_geometry.errors import FcsvError


class StereoError(FcsvError):
    """Base of all errors of this package."""


class InputError(StereoError):
    """A session, bag or folder of photographs that cannot be mapped."""


class MatchingError(StereoError):
    """Pictures were read but nothing could be matched."""


class OutputError(StereoError):
    """The result cannot be written where it was asked for."""


class PlanError(StereoError):
    """A plan that contradicts itself, or that cannot be flown."""


class SurveyError(StereoError):
    """Maps that cannot be joined to a site, or an input of a survey that cannot be used."""


class DamagedMapError(SurveyError):
    """A folder that is no map, or whose files are not whole."""
