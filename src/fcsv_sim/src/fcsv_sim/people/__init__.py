# SPDX-License-Identifier: Apache-2.0
"""Operator, transmitter, Tello pilot."""
