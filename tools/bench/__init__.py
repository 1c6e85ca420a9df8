# SPDX-License-Identifier: Apache-2.0
"""make bench: every mapping method on the same rendered pictures, against truth; tables to
docs/lab/benchmarks.md."""
