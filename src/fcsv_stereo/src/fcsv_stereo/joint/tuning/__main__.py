# SPDX-License-Identifier: Apache-2.0
"""Print the table of tuned numbers."""

from fcsv_stereo.joint.tuning import STAGES, table

if __name__ == "__main__":
    print("\n".join(line for stage in STAGES for line in table(stage)))
