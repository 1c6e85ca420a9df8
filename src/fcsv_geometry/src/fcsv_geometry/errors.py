# SPDX-License-Identifier: Apache-2.0
"""Errors that every fcsv package builds on: one line that names what is wrong, where, and what to
do."""


class FcsvError(Exception):
    """Base of all fcsv errors; commands print it as one line and exit with a non-zero status."""


class ConfigError(FcsvError):
    """A configuration file has an unknown key, a value out of range, or cannot be read.

    ``field`` is the path of what is wrong ("configurations[1].baseline_m"; empty: the file as a
    whole), ``problem`` what is wrong with it.
    """

    def __init__(self, text: str, field: str = "", problem: str = ""):
        super().__init__(text)
        self.field, self.problem = field, problem or text


class MissionError(FcsvError):
    """A mission cannot be flown as listed: not by this fleet, not at these places, or no longer.
    Then all land."""


class PlanRefused(MissionError):
    """A mission of which a leg cannot be flown."""


class GeometryError(FcsvError):
    """A transform, quaternion or camera model is not what it claims to be (NaN, not a rotation,
    ...)."""


class PoseUnavailable(FcsvError):
    """No pose can be given for the asked stamp: nothing near enough in time. Drop the data, count
    it."""


class BagError(FcsvError):
    """A bag that cannot be read or repaired; it is left as it was."""


class PictureFileError(FcsvError):
    """A picture file that cannot be read whole; the message names it."""
