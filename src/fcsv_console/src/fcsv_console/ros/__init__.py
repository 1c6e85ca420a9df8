# SPDX-License-Identifier: Apache-2.0
"""Topics, services and actions to the view-model and back; nothing here blocks who shows it."""
