# SPDX-License-Identifier: Apache-2.0
"""What all packages stand on: transforms, cameras, trajectories, frames in home, strict
configuration, the mission's schema, the tracker's profile, counters and gates of message flows."""
