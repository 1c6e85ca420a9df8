# SPDX-License-Identifier: Apache-2.0
"""System I: a robot with gimbals and the two Tellos that they see."""
