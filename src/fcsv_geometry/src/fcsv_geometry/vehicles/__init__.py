# SPDX-License-Identifier: Apache-2.0
"""What is fixed on a vehicle, and what it tells of itself."""
