# SPDX-License-Identifier: Apache-2.0
"""Pictures and true depth of the town: Embree casts the rays, compiled kernels shade what they
hit."""
