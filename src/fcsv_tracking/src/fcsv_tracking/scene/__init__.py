# SPDX-License-Identifier: Apache-2.0
"""What a camera's pictures say of how it moved."""
