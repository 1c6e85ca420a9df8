# SPDX-License-Identifier: Apache-2.0
"""Names of network namespaces, while they are made."""

import pytest

from fcsv_geometry.programs import netns


def test_a_file_on_which_no_namespace_is_mounted_yet_is_none(monkeypatch, tmp_path):
    # `ip netns add` leaves this between its two steps, a killed one for good
    monkeypatch.setattr(netns, "FOLDER", tmp_path)
    assert not netns.exists("tello1-pilot")
    (tmp_path / "tello1-pilot").touch()
    assert not netns.exists("tello1-pilot")
    with pytest.raises(netns.NamespaceError, match="tello1-pilot: its file is not one, or .* made"):
        with netns.inside("tello1-pilot"):
            pass


def test_a_namespace_that_can_be_entered_exists(monkeypatch):
    monkeypatch.setattr(netns, "FOLDER", "/proc/self/ns")
    assert netns.exists("net") and not netns.exists("nothing")
