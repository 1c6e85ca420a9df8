# SPDX-License-Identifier: Apache-2.0
"""Views of a site: the maps of reference pictures, what is known of their places beforehand, and
the inputs that they are made of."""
