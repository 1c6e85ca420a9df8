# SPDX-License-Identifier: Apache-2.0
"""Sockets in another network namespace (network_namespaces(7)), while the process stays where its
ROS master is.

For devices that all have the same address, as every Tello has 192.168.10.1: each one's Wi-Fi
interface stands in a namespace of its own. A socket belongs to the namespace in which it was
opened. Entering one needs root, or CAP_SYS_ADMIN.
"""

import contextlib
import ctypes
import errno
import os
from typing import Iterator

from fcsv_geometry.errors import FcsvError

FOLDER = "/run/netns"
_CLONE_NEWNET = 0x40000000
_LIBC = ctypes.CDLL(None, use_errno=True)


class NamespaceError(FcsvError):
    """A namespace cannot be made or entered; the message says why and what to do instead."""


def exists(name: str) -> bool:
    """Whether there is a namespace of this name that can be entered: ``ip netns add`` makes an
    empty file first, and then mounts the namespace on it."""
    try:
        return os.stat(f"{FOLDER}/{name}").st_dev != os.stat(FOLDER).st_dev
    except FileNotFoundError:
        return False


@contextlib.contextmanager
def inside(name: str) -> Iterator[None]:
    """This thread is in the namespace; what it opens, and threads that it starts, stay there.
    Raises NamespaceError.

    An empty name: it stays where it is.
    """
    if not name:
        yield
        return
    try:
        back = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    except OSError as error:
        raise NamespaceError(
            f"network namespace {name}: this kernel has none ({error.strerror})"
        ) from error
    try:
        _enter(_opened(name), name)
        try:
            yield
        finally:
            _enter(os.dup(back), "the one before")
    finally:
        os.close(back)


def _opened(name: str) -> int:
    try:
        return os.open(f"{FOLDER}/{name}", os.O_RDONLY)
    except OSError as error:
        raise NamespaceError(
            f"network namespace {name}: {error.strerror}; make it first, as root"
        ) from error


def _enter(descriptor: int, name: str) -> None:
    """Closes the descriptor."""
    try:
        if _LIBC.setns(descriptor, _CLONE_NEWNET):
            number = ctypes.get_errno()
            why = "its file is not one, or it is being made" if number == errno.EINVAL else None
            raise NamespaceError(
                f"network namespace {name}: {why or os.strerror(number) + '; root is needed'}"
            )
    finally:
        os.close(descriptor)
