# SPDX-License-Identifier: Apache-2.0
"""The field's metrics on distributions whose figures are known."""

import doctest
import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import halfnorm, norm

from fcsv_stereo.evaluating import depth_metrics, evaluation
from fcsv_stereo.evaluating.depth_metrics import (
    LEVELS,
    ause,
    interval_coverage,
    overconfident_share,
)

N = 200_000
CHANCE = 0.005  # 4 standard deviations of a share of N pixels are 0.45 %


def normal(seed=1):
    """True depths of 10 to 400 m, sigmas of 0.5 to 5 % of them, and depths with errors of these
    sigmas."""
    random = np.random.default_rng(seed)
    true = random.uniform(10.0, 400.0, N)
    sigma = true * random.uniform(0.005, 0.05, N)
    return true, sigma, true + sigma * random.standard_normal(N)


def uninformed_ause(quantile, mean):
    """Of uncertainty that says nothing: the oracle's mean of the share c is the integral of the
    quantiles to c over c; its mean over all c is the integral of the quantiles times -ln(u)."""
    return 1.0 - quad(lambda u: -quantile(u) * np.log(u), 0.0, 1.0)[0] / mean


def test_formulas_in_the_docstrings():
    assert doctest.testmod(depth_metrics, extraglobs={"np": np}).failed == 0


def test_right_sigmas_are_covered_as_each_level_says():
    true, sigma, depth = normal()
    m = depth_metrics.depth_metrics(depth, sigma, true)
    assert [level for level, _ in m.interval_coverage] == list(LEVELS) == [0.5, 0.68, 0.9, 0.95]
    assert [share for _, share in m.interval_coverage] == pytest.approx(LEVELS, abs=CHANCE)
    assert (np.abs(depth - true) <= sigma).mean() == pytest.approx(0.683, abs=CHANCE)
    assert m.sharpness == pytest.approx(0.0275, rel=0.02)
    # |error| of a normal is 0.798 sigma in the mean
    assert m.mean_relative_error == pytest.approx(0.0275 * np.sqrt(2.0 / np.pi), rel=0.02)
    s = np.linspace(0.005, 0.05, 1001)
    inside = norm.cdf(0.03 / s) - norm.cdf((1.0 / 1.03 - 1.0) / s)
    assert m.within_3_percent == pytest.approx(inside.mean(), abs=CHANCE)


@pytest.mark.parametrize("factor, covered", [(0.5, 0.589), (2.0, 0.999)])
def test_sigmas_that_are_off_by_a_factor_show_in_coverage_and_sharpness_and_not_in_their_order(
    factor, covered
):
    """Coverage at 90 % of sigmas of half and double: P(|x| < 0.822) and P(|x| < 3.29)."""
    true, sigma, depth = normal()
    right, off = (depth_metrics.depth_metrics(depth, k * sigma, true) for k in (1.0, factor))
    assert dict(off.interval_coverage)[0.9] == pytest.approx(covered, abs=CHANCE)
    assert off.sharpness == pytest.approx(factor * right.sharpness)
    assert off.ause == pytest.approx(right.ause, abs=1e-9)
    assert off.overconfident_share == pytest.approx(right.overconfident_share, abs=1e-9)


@pytest.mark.parametrize(
    "name, draw, quantile, mean",
    [
        ("uniform", lambda r: r.uniform(size=N), lambda u: u, 0.5),
        ("exponential", lambda r: r.exponential(size=N), lambda u: -np.log1p(-u), 1.0),
        ("half normal", lambda r: np.abs(r.standard_normal(N)), halfnorm.ppf, np.sqrt(2.0 / np.pi)),
    ],
)
def test_uncertainty_that_says_nothing_has_the_analytic_ause(name, draw, quantile, mean):
    random = np.random.default_rng(2)
    error, wanted = draw(random), uninformed_ause(quantile, mean)
    assert ause(error, np.ones(N)) == pytest.approx(wanted, rel=0.01)
    # in a random order the first pixels' mean errors are chance
    assert ause(error, random.uniform(size=N)) == pytest.approx(wanted, rel=0.02)


def test_ause_of_exponential_errors_is_known_in_closed_form():
    assert uninformed_ause(lambda u: -np.log1p(-u), 1.0) == pytest.approx(np.pi**2 / 6.0 - 1.0)


def test_ause_of_normal_errors_with_their_own_sigmas():
    """Right sigmas, uniform in 1 to 2: the risk by sigma at share c is E|x| (1 + c / 2). The
    oracle's is by quadrature, because |errors| of one sigma still scatter: AUSE is not 0."""
    random = np.random.default_rng(3)
    sigma = random.uniform(1.0, 2.0, N)
    error = sigma * np.abs(random.standard_normal(N))
    u = (np.arange(1000) + 0.5) / 1000
    quantiles = np.sort(np.outer(1.0 + u, halfnorm.ppf(u)), axis=None)
    oracle = np.mean(-np.log((np.arange(quantiles.size) + 0.5) / quantiles.size) * quantiles)
    wanted = (1.25 - oracle / np.sqrt(2.0 / np.pi)) / 1.5
    assert ause(error, sigma) == pytest.approx(wanted, rel=0.02)
    assert 0.0 < ause(error, sigma) < ause(error, np.ones(N)) < ause(error, -sigma)


def test_order_of_pixels_does_not_matter_where_sigma_is_the_same():
    """Sky and far pixels come first in a picture: a sort that keeps their order would call them the
    surest."""
    error = np.linspace(1.0, 0.0, 1000)
    for e in (error, error[::-1]):
        assert ause(e, np.ones(1000)) == pytest.approx(0.5, abs=0.01)
        assert overconfident_share(e, np.ones(1000)) == pytest.approx(0.2)


def test_overconfident_share_of_known_mixtures():
    """A tenth of all errors is large; half of these state the least sigma: of the worst 5 % half
    are there."""
    error, sigma = np.full(N, 0.01), np.full(N, 1.0)
    error[: N // 10], sigma[: N // 20] = 1.0, 0.1
    assert overconfident_share(error, sigma) == pytest.approx(0.5 + 0.5 * (0.2 - 0.05) / 0.95)
    random = np.random.default_rng(4)
    assert overconfident_share(random.uniform(size=N), random.uniform(size=N)) == pytest.approx(
        0.2, abs=0.02
    )


def test_the_worst_group_is_found_and_small_ones_are_left_out():
    true, sigma, depth = normal()
    far, few = true > 200.0, np.arange(N) < 0.009 * N
    depth = np.where(far, true + 2.0 * (depth - true), depth)
    depth[few] = 10.0 * true[few]
    groups = {"near": ~far & ~few, "far": far & ~few, "few": few}
    worst = depth_metrics.depth_metrics(depth, sigma, true, groups).worst_group
    # errors of 2 sigma within 1.645 of them: P(|x| < 0.822)
    assert worst.name == "far" and worst.pixels == groups["far"].sum()
    assert worst.coverage == pytest.approx(0.589, abs=2 * CHANCE)
    assert depth_metrics.depth_metrics(depth, sigma, true, {"few": few}).worst_group is None


def test_what_is_exact_and_what_is_empty():
    true = np.array([10.0, 20.0, 30.0])
    m = depth_metrics.depth_metrics(true, np.zeros(3), true)
    assert (m.mean_relative_error, m.within_3_percent, m.ause) == (0.0, 1.0, 0.0)
    assert all(share == 1.0 for _, share in m.interval_coverage)
    assert depth_metrics.depth_metrics(true[:0], true[:0], true[:0]) is None
    assert interval_coverage(np.array([1.0]), np.array([0.0]), 0.9) == 0.0


def result(depth, sigma):
    return SimpleNamespace(
        depth=depth.astype(np.float32), sigma=sigma.astype(np.float32), images=[], reference=None
    )


def test_evaluation_has_them_by_band_of_distance():
    """Without what is not answered, beyond the range, or in the sky; a depth without a sigma is
    left out alone."""
    true, sigma, depth = (a.reshape(400, 500) for a in normal())
    depth = np.where(true > 100.0, depth, true + 3.0 * (depth - true))
    true[:10], depth[10:20], sigma[20] = np.nan, np.nan, np.nan
    e = evaluation.evaluate(result(depth, sigma), None, true, 300.0)
    judged = np.isfinite(depth) & (true <= 300.0) & np.isfinite(sigma)
    alone = depth_metrics.depth_metrics(depth[judged], sigma[judged], true[judged])
    assert e.metrics.mean_relative_error == pytest.approx(alone.mean_relative_error, rel=1e-5)
    assert e.metrics.worst_group.name in ("0 to 50 m", "50 to 100 m")
    assert e.metrics.worst_group.coverage == pytest.approx(0.416, abs=0.02)  # P(|x| < 1.645 / 3)
    found = json.loads(json.dumps(e.to_dict(), allow_nan=False))["metrics"]
    assert list(found["interval_coverage"]) == ["50%", "68%", "90%", "95%"]
    assert found["worst_group"]["level"] == "90%" and found["ause"] == pytest.approx(e.metrics.ause)


def test_a_map_without_depths_has_none_of_them():
    true = np.full((4, 5), 10.0)
    e = evaluation.evaluate(result(np.full((4, 5), np.nan), np.full((4, 5), np.nan)), None, true)
    assert e.metrics is None and e.to_dict()["metrics"] is None
