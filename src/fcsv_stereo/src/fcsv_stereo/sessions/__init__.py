# SPDX-License-Identifier: Apache-2.0
"""Sessions of ROS 1 or ROS 2 as input of a map, read without ROS (docs/design/architecture.md,
"Session")."""

from fcsv_stereo.sessions.files import is_session
from fcsv_stereo.sessions.read import read_session
from fcsv_stereo.sessions.views import session_views

__all__ = ["is_session", "read_session", "session_views"]
