# SPDX-License-Identifier: Apache-2.0
"""Places where two vehicles look from, drawn and mapped once."""
