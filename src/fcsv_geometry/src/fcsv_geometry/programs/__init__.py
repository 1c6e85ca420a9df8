# SPDX-License-Identifier: Apache-2.0
"""How commands and nodes begin, show their way and end."""
