# SPDX-License-Identifier: Apache-2.0
"""The flight link and MAVROS's companion as nodes."""
