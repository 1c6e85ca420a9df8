# SPDX-License-Identifier: Apache-2.0
"""The ground in the forms that robots and people read, and the command that writes them."""
