# SPDX-License-Identifier: Apache-2.0
"""What the crew of a survey does, each piece a task whose result is kept with the key of what went
into it."""
