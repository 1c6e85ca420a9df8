# SPDX-License-Identifier: Apache-2.0
"""Where camera and tag sit on a vehicle, from the vehicle moved by hand: nobody needs a ruler."""
