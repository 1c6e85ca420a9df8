# SPDX-License-Identifier: Apache-2.0
"""What ``rosrun fcsv_control`` runs on a desk."""

import argparse
import sys
from typing import Callable, List, Optional

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.writing import in_words

Action = Callable[[argparse.Namespace], int]


def run(parser: argparse.ArgumentParser, argv: Optional[List[str]], action: Action) -> int:
    """The action's exit status; 2 with one line on stderr that says what is wrong, 130 on Ctrl-C."""
    args = parser.parse_args(argv)
    try:
        return action(args)
    except FcsvError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{parser.prog}: {in_words(error, getattr(args, 'out', None) or '')}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{parser.prog}: interrupted", file=sys.stderr)
        return 130
