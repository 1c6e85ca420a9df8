# SPDX-License-Identifier: Apache-2.0
"""Flows of messages: stamps, ages, what was dropped."""
