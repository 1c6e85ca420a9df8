# SPDX-License-Identifier: Apache-2.0
"""The chi-squared distribution as ``scipy.stats.chi2`` has it, without that package's import: it
takes half a second, which every node and every worker would pay."""

from scipy.special import chdtrc, gammaincinv


def quantile(p: float, freedom: int) -> float:
    """What a sum of ``freedom`` squared standard normals stays below with probability ``p``.

    >>> round(quantile(0.95, 1), 3)
    3.841
    """
    return float(2.0 * gammaincinv(freedom / 2.0, p))


def probability_beyond(value: float, freedom: int) -> float:
    """Gives the probability that such a sum is larger than ``value``.

    >>> round(probability_beyond(3.841, 1), 3)
    0.05
    """
    return float(chdtrc(freedom, value))
