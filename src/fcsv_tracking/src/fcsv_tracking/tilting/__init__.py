# SPDX-License-Identifier: Apache-2.0
"""The tilting stereo camera (thesis 7.2, figure 7.1): two cameras on one beam, each turned inward
by a servo."""
