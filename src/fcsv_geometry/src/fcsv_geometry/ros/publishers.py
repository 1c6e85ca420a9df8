# SPDX-License-Identifier: Apache-2.0
"""No publisher that the master told of is forgotten: mends a race in rospy (1.17.4,
``rospy.impl.registration``).

A subscriber is registered, and the master answers with the publishers of then. Where one registers
meanwhile, the master tells of it at once, and that news may be taken in before the answer. rospy
keeps only what it took in last, so that the older answer, often an empty one, stands for the news,
and the two never connect: seen as a flight check that never heard one of two vehicles, on a busy
machine.
"""

from typing import Sequence

from rospy.impl.registration import RegManager


def keep_all() -> None:
    """Takes effect from here on in this process; to be called before ``rospy.init_node``, any
    number of times."""
    RegManager.publisher_update = _publisher_update


def _publisher_update(self: RegManager, resolved_name: str, uris: Sequence[str]) -> None:
    """Stands in place of rospy's: addresses that still wait are tried, too. One that is gone by
    then refuses, which is all."""
    with self.cond:
        waiting = [uri for name, older in self.updates if name == resolved_name for uri in older]
        self.updates.append((resolved_name, list(dict.fromkeys([*uris, *waiting]))))
        self.cond.notify_all()
