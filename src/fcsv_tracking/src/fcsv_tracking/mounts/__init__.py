# SPDX-License-Identifier: Apache-2.0
"""Where camera and tag sit on a vehicle, from views of a tag while the vehicle is moved by hand."""
