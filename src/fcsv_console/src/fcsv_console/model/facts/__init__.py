# SPDX-License-Identifier: Apache-2.0
"""What the console is told: the contents of messages, one frozen dataclass each. Units are in the names."""

from typing import Union

from fcsv_console.model.facts.of_console import (
    EpipolarTold,
    JobTold,
    MasterTold,
    PlacesFound,
    RehearsalTold,
    Unusable,
)
from fcsv_console.model.facts.of_control import (
    Calibrated,
    Check,
    HomeSet,
    MapPicture,
    MapTold,
    MissionAlive,
    MissionFlown,
    MissionTold,
    SeenFrom,
    StopTold,
)
from fcsv_console.model.facts.of_vehicle import (
    Agent,
    Answered,
    AutopilotState,
    Battery,
    CameraInHome,
    CameraKnown,
    Captured,
    Clock,
    Diagnosed,
    EpochHeard,
    Guardian,
    NotInBags,
    OdometryHeard,
    PictureHeard,
    Radio,
    Recorder,
    Said,
    Tags,
)

OfVehicle = Union[AutopilotState, Battery, OdometryHeard, CameraInHome, CameraKnown, PictureHeard, Guardian, Agent,
                  Recorder, Clock, EpochHeard, Radio, Said, Answered, Tags, Captured, Diagnosed, NotInBags]  # fmt: skip
Fact = Union[OfVehicle, Calibrated, HomeSet, Check, MissionTold, MissionFlown, MissionAlive, StopTold, MapTold,
             EpipolarTold, MapPicture, SeenFrom, RehearsalTold, JobTold, PlacesFound, Unusable, MasterTold]  # fmt: skip

__all__ = [
    "Agent",
    "Answered",
    "AutopilotState",
    "Battery",
    "Calibrated",
    "CameraInHome",
    "CameraKnown",
    "Captured",
    "Check",
    "Clock",
    "Diagnosed",
    "EpipolarTold",
    "EpochHeard",
    "Fact",
    "Guardian",
    "HomeSet",
    "JobTold",
    "MapPicture",
    "MapTold",
    "MasterTold",
    "MissionAlive",
    "MissionFlown",
    "MissionTold",
    "NotInBags",
    "OdometryHeard",
    "OfVehicle",
    "PictureHeard",
    "PlacesFound",
    "Radio",
    "Recorder",
    "RehearsalTold",
    "Said",
    "SeenFrom",
    "StopTold",
    "Tags",
    "Unusable",
]
