# SPDX-License-Identifier: Apache-2.0
"""What ``rosrun fcsv_tracking`` runs on a desk: calibration of cameras and mounts, trajectories, evaluation."""

import argparse
import sys
from typing import Callable, List, Optional

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.writing import in_words

Action = Callable[[argparse.Namespace], None]


def run(parser: argparse.ArgumentParser, argv: Optional[List[str]], action: Action) -> int:
    """Exit status 0, or 2 with one line on stderr that says what is wrong, 130 on Ctrl-C."""
    args = parser.parse_args(argv)
    try:
        action(args)
    except (FcsvError, ValueError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{parser.prog}: {in_words(error, getattr(args, 'out', None) or '')}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{parser.prog}: interrupted", file=sys.stderr)
        return 130
    return 0
