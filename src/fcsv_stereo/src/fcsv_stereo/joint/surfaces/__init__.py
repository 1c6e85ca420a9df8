# SPDX-License-Identifier: Apache-2.0
"""Choice among planes at each finer size."""
