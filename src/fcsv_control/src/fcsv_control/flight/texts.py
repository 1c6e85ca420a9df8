# SPDX-License-Identifier: Apache-2.0
"""STATUSTEXT of 50 characters a piece, put together again."""

from typing import Dict, List, Optional, Tuple


class TextJoiner:
    """Joins the chunks of a text; one without an id is whole at once."""

    def __init__(self):
        self._open: Dict[int, List[str]] = {}

    def add(self, severity: int, text: str, text_id: int = 0, chunk: int = 0) -> Optional[Tuple[int, str]]:
        """Severity and text once it is whole, else None. A chunk shorter than 50 characters is the last."""
        if text_id == 0:
            return severity, text
        chunks = self._open.setdefault(text_id, [])
        while len(chunks) <= chunk:
            chunks.append("...")  # a lost chunk leaves a mark
        chunks[chunk] = text
        if len(text) >= 50:
            return None
        del self._open[text_id]
        return severity, "".join(chunks)
