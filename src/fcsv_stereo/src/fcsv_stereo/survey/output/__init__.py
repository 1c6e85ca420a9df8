# SPDX-License-Identifier: Apache-2.0
"""What a survey tells: the page, recordings, products that are asked for; and its folder read
back."""
