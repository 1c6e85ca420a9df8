# SPDX-License-Identifier: Apache-2.0
"""What methods take and give back: pictures, configurations, inputs, results. Nothing here maps
anything."""

from fcsv_stereo.model.configuration import Configuration
from fcsv_stereo.model.inputs import FLOWN, RIG, ConfigurationInput, MapInput, PosePrior
from fcsv_stereo.model.method import Method, part, silent
from fcsv_stereo.model.pairs import Pair, PairResult
from fcsv_stereo.model.pictures import LivePicture, Picture, Reference, as_grey, as_rgb
from fcsv_stereo.model.pose_uncertainty import PoseUncertainty
from fcsv_stereo.model.results import Cloud, CloudCut, ImageEntry, MapResult, Progress, concatenate
from fcsv_stereo.model.words import AXES, Axis, InputKind, Word

__all__ = [
    "AXES",
    "Axis",
    "Cloud",
    "CloudCut",
    "Configuration",
    "ConfigurationInput",
    "FLOWN",
    "ImageEntry",
    "LivePicture",
    "MapInput",
    "MapResult",
    "Method",
    "Pair",
    "PairResult",
    "Picture",
    "PosePrior",
    "PoseUncertainty",
    "Progress",
    "RIG",
    "Reference",
    "InputKind",
    "Word",
    "as_grey",
    "as_rgb",
    "concatenate",
    "part",
    "silent",
]
