# SPDX-License-Identifier: Apache-2.0
"""What flies: flight link, vehicle agent, mission, recording."""
