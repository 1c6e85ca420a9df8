# SPDX-License-Identifier: Apache-2.0
"""What is done for the running configuration, and for all vehicles."""
