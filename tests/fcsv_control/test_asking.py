# SPDX-License-Identifier: Apache-2.0
"""A request whose effect shows later than its answer: what is sent again, what ends it, what its
caller is told."""

import pytest

from fcsv_control.agent.asking import SHOWS_S, STOP_PATIENCE_S, STOP_REPEAT_S, Asking, Shown
from fcsv_control.errors import ControlError
from fcsv_geometry.vehicles.modes import Mode

STEP_S = 0.01


@pytest.fixture
def shown():
    s = Shown()
    s.state(9.0, Mode.LOITER, True)
    return s


def sent(asking, since_s, seconds):
    """When it is sent, from then on."""
    times = [since_s + k * STEP_S for k in range(int(round(seconds / STEP_S)))]
    return [t for t in times if not asking.over and asking.step(t)]


def test_guided_is_sent_once_and_over_when_it_shows(shown):
    asking = Asking.mode(shown, 10.0, Mode.GUIDED)
    assert sent(asking, 10.0, 1.0) == [10.0] and not asking.over
    shown.state(11.0, Mode.GUIDED, True)
    assert sent(asking, 11.0, 0.1) == [] and asking.over


@pytest.mark.parametrize("mode", [Mode.LAND, Mode.BRAKE])
def test_a_mode_that_stops_is_sent_again_until_it_shows(shown, mode):
    asking = Asking.mode(shown, 10.0, mode)
    assert len(sent(asking, 10.0, 1.0)) == pytest.approx(1.0 / STOP_REPEAT_S, abs=1)
    shown.state(11.0, mode, True)
    assert sent(asking, 11.0, 1.0) == [] and asking.over


def test_a_pilot_who_takes_over_from_land_is_not_overruled(shown):
    """LAND showed for a moment, between two looks at the state."""
    asking = Asking.mode(shown, 10.0, Mode.LAND)
    sent(asking, 10.0, 0.05)
    shown.state(10.06, Mode.LAND, True)
    shown.state(10.07, Mode.STABILIZE, True)
    assert sent(asking, 10.08, 1.0) == [] and asking.over


def test_a_newer_mode_ends_the_older_request(shown):
    guided = Asking.mode(shown, 10.0, Mode.GUIDED)
    sent(guided, 10.0, 0.1)
    land = Asking.mode(shown, 10.1, Mode.LAND)
    with pytest.raises(ControlError, match="mode GUIDED was overtaken by a newer command"):
        guided.step(10.11)
    assert land.step(10.11)


def test_a_refusal_ends_it_with_its_reason_but_not_one_of_before(shown):
    shown.refused("of before")
    asking = Asking.mode(shown, 10.0, Mode.GUIDED)
    sent(asking, 10.0, 0.2)
    shown.refused("Mode change to GUIDED failed: requires position")
    with pytest.raises(ControlError, match="requires position"):
        asking.step(10.3)


def test_what_never_shows_is_told_with_what_shows(shown):
    asking = Asking.mode(shown, 10.0, Mode.GUIDED)
    sent(asking, 10.0, SHOWS_S)
    with pytest.raises(
        ControlError, match="mode GUIDED was sent, but the vehicle is in LOITER, armed"
    ):
        asking.step(10.01 + SHOWS_S)
    brake = Asking.mode(shown, 20.0, Mode.BRAKE)
    assert sent(brake, 20.0, STOP_PATIENCE_S - 0.1)[-1] > 24.5
    with pytest.raises(ControlError, match="mode BRAKE was sent"):
        brake.step(20.01 + STOP_PATIENCE_S)


def test_a_link_that_took_long_to_answer_leaves_the_state_its_time(shown):
    """Our own link answers when the mode shows; mavros/state comes a little later."""
    asking = Asking.mode(shown, 10.0, Mode.GUIDED)
    assert asking.step(10.0)
    asking.answered(14.0)
    assert not asking.step(14.1)
    shown.state(14.2, Mode.GUIDED, True)
    assert not asking.step(14.3) and asking.over


def test_what_shows_already_is_sent_once_all_the_same(shown):
    """The pilot may have switched just now: the next heartbeat tells."""
    asking = Asking.mode(shown, 10.0, Mode.LOITER)
    assert sent(asking, 10.0, 0.1) == [10.0] and asking.over


def test_arming_shows_in_the_heartbeat(shown):
    shown.state(9.5, Mode.GUIDED, False)
    asking = Asking.arming(shown, 10.0, True)
    assert sent(asking, 10.0, 0.9) == [10.0] and not asking.over
    shown.state(10.9, Mode.GUIDED, True)
    sent(asking, 10.9, 0.1)
    assert asking.over
