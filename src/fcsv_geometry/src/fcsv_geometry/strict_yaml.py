# SPDX-License-Identifier: Apache-2.0
"""YAML in which a key stands once: of two the last would win without a word."""

from typing import Any

import yaml

_MERGE = "tag:yaml.org,2002:merge"


class _UniqueKeyLoader(yaml.SafeLoader):
    """The safe loader; raises yaml.YAMLError, with its line, on a key that stands twice."""

    def compose_mapping_node(self, anchor):
        node = super().compose_mapping_node(anchor)
        first = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
                continue
            before = first.setdefault((key.tag, key.value), key)
            if before is not key:
                line = before.start_mark.line + 1
                raise yaml.constructor.ConstructorError(
                    problem=f"'{key.value}' stands twice, first in line {line}; keep one of them",
                    problem_mark=key.start_mark,
                )
        return node


def parse(text: str) -> Any:
    """The document in a text. Raises yaml.YAMLError on all that is none.

    >>> try:
    ...     parse("radius_m: 0.4\\nheight_m: 1\\nradius_m: 0.1\\n")
    ... except yaml.YAMLError as error:
    ...     print(error.problem_mark.line + 1, error.problem)
    3 'radius_m' stands twice, first in line 1; keep one of them
    """
    try:
        return yaml.load(text, Loader=_UniqueKeyLoader)
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deep") from error
    except ValueError as error:  # of a date that is none, or of a number of thousands of digits
        raise yaml.YAMLError(str(error).partition(";")[0]) from error
