# SPDX-License-Identifier: Apache-2.0
"""The tracker of thesis chapter 4: gimbal cameras on a ground robot that follow tags on
vehicles."""
