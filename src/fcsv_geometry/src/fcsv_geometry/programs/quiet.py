# SPDX-License-Identifier: Apache-2.0
"""Loggers that are silent for a while."""

import contextlib
import logging
from typing import Iterator


@contextlib.contextmanager
def quiet(name: str) -> Iterator[None]:
    """Lets the logger ``name`` say errors alone until the block is left."""
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)
