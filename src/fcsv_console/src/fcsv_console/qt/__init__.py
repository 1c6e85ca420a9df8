# SPDX-License-Identifier: Apache-2.0
"""The view-model as a window: widgets that show a view and tell which action was asked for, no
more."""
