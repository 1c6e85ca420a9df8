# SPDX-License-Identifier: Apache-2.0
"""The method ``thesis``: pair by pair as the thesis did it. What it shares with ``joint`` stands
one level up."""

from fcsv_stereo.thesis.method import Thesis, ThesisOptions, map_thesis

__all__ = ["Thesis", "ThesisOptions", "map_thesis"]
