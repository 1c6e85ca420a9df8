# SPDX-License-Identifier: Apache-2.0
"""What must be well for the mission to go on."""
