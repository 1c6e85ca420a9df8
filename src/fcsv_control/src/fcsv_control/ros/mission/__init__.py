# SPDX-License-Identifier: Apache-2.0
"""The mission, and who stops everybody, as nodes on the control PC."""
