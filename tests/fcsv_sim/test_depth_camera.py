# SPDX-License-Identifier: Apache-2.0
"""The simulated depth camera: its noise, its range and its holes, on depth that is known."""

import numpy as np
import pytest

from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.sensors.depth_camera import DepthParameters, SimulatedDepth
from fcsv_stereo.near import DepthSensor

CAMERA = PinholeCamera.from_fov(320, 240, np.radians(56.0))
SENSOR = DepthSensor()
TEXTURE = np.random.default_rng(1).integers(60, 180, (240, 320, 3)).astype(np.uint8)
KIND = DepthParameters(speckle=0.0)


def measured(depth, rgb=TEXTURE, seed=1, sensor=SENSOR, parameters=KIND):
    """Depth in m, NaN where there is none."""
    found = SimulatedDepth(CAMERA, seed, sensor, parameters).measure(
        np.full((240, 320), depth, np.float32), rgb
    )
    assert found.dtype == np.uint16
    return np.where(found > 0, found / 1000.0, np.nan)


@pytest.mark.parametrize("z", [1.0, 3.0, 6.0])
def test_noise_is_that_of_the_sensors_model(z):
    """And of a step of 1/32 px, 0.009 px rms, which is small beside it."""
    without_offset = DepthSensor(offset_px=1e-9)
    found = measured(z, sensor=without_offset)
    assert np.isfinite(found).mean() > 0.98
    assert np.nanstd(found) == pytest.approx(float(SENSOR.noise_m(z)), rel=0.12)
    assert abs(np.nanmedian(found) - z) < 0.001 + 0.2 * SENSOR.noise_m(z)  # whole mm


def test_neighbours_are_wrong_together_and_frames_apart():
    simulated = SimulatedDepth(CAMERA, 1, SENSOR, KIND)
    depth = np.full((240, 320), 4.0, np.float32)
    first, second = (simulated.measure(depth, TEXTURE).astype(float) for _ in range(2))
    assert np.corrcoef(first[:, 1:].ravel(), first[:, :-1].ravel())[0, 1] > 0.6
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.1


def test_a_camera_keeps_its_calibration_error():
    medians = [np.nanmedian(measured(8.0, seed=seed)) for seed in range(40)]
    assert np.std(medians) == pytest.approx(float(SENSOR.offset_m(8.0)), rel=0.35)
    assert np.array_equal(measured(8.0, seed=3), measured(8.0, seed=3), equal_nan=True)


@pytest.mark.parametrize("z", [0.2, 14.0, np.nan])
def test_beyond_its_range_and_in_the_sky_there_is_nothing(z):
    assert not np.isfinite(measured(z)).any()


@pytest.mark.parametrize(
    "rgb", [np.full_like(TEXTURE, 4), np.full_like(TEXTURE, 252), np.full_like(TEXTURE, 120)]
)
def test_dark_glaring_and_plain_surfaces_have_no_depth(rgb):
    assert not np.isfinite(measured(3.0, rgb)).any()


def test_edges_have_holes_and_depths_between_and_a_shadow_to_the_left():
    depth = np.full((240, 320), 6.0, np.float32)
    depth[:, 150:200] = 2.0
    found = measured(depth)
    # f b (1/2 - 1/6) = 5 px of the wall left of the near thing are hidden from the right imager
    shadow = CAMERA.fx * SENSOR.baseline_m * (1 / 2.0 - 1 / 6.0)
    assert 4.0 < shadow < 6.0 and np.isfinite(found[:, 146:150]).mean() < 0.2
    assert np.isfinite(found[:, 203:207]).mean() > 0.9
    edge = found[:, 200:202]
    assert 0.2 < 1 - np.isfinite(edge).mean() < 0.6 and ((edge > 2.6) & (edge < 5.0)).any()
    assert (
        np.isfinite(found[:, 160:190]).mean() > 0.99 and np.isfinite(found[:, 220:]).mean() > 0.99
    )


@pytest.mark.parametrize("wrong", [{"window_px": 4}, {"edge_holes": 0.9, "edge_between": 0.2}])
def test_parameters_that_are_none_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DepthParameters(**wrong)
