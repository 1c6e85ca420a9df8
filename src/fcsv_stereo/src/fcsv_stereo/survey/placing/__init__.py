# SPDX-License-Identifier: Apache-2.0
"""Places of all views together: the adjustment, and what ties a site to the earth."""
