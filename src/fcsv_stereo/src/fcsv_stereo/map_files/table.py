# SPDX-License-Identifier: Apache-2.0
"""The last words of a run: a small table of what came out."""

from fcsv_stereo.evaluating.evaluation import Moving


def demo_table(document: dict) -> str:
    """Text of a report.json: configurations, coverage, seconds, and, where truth is, the errors by
    range."""
    lines = [
        f"method {document['method']}, reference {document['reference']['image']}, {document['points']} points"
    ]
    # whole: cut names read alike
    wide = max([40, *(len(c["name"]) for c in document["configurations"])])
    lines.append(f"{'configuration':<{wide}} {'effective range':>18} {'matched':>8} {'skew':>8}")
    for c in document["configurations"]:
        near, far = c["effective_range_m"]
        skew = "-" if c.get("skew_ms") is None else f"{c['skew_ms']:.0f} ms"
        lines.append(
            f"{c['name']:<{wide}} {f'{near:.0f} to {far:.0f} m':>18} {c['match_rate']:>8.0%} {skew:>8}"
        )
    cut = document.get("cloud")
    if cut and cut["beyond_range"] + cut["beyond_sigma"]:
        lines.append(
            f"left out of the cloud: {cut['beyond_range']} points too far, {cut['beyond_sigma']} too unsure"
        )
    timing = document["timing_s"]
    steps = ", ".join(f"{k} {seconds:.1f}" for k, seconds in timing.items() if k != "total")
    lines.append(
        f"coverage {document['coverage']:.0%} of the picture; processed in {timing['total']:.1f} s ({steps})"
    )
    truth = document.get("truth")
    if truth:
        lines += _truth_lines(truth)
    lines += [f"warning: {w}" for w in document.get("warnings", [])]
    lines += [f"not seen: {u}" for u in document.get("unseen", [])]
    return "\n".join(lines)


def _truth_lines(truth: dict):
    lines = [
        f"{'range (m)':<12} {'pixels':>8} {'covered':>8} {'within 10 %':>12} {'median error':>13}"
    ]
    rows = [
        *truth["bands"],
        {
            **truth,
            "range_m": (0.0, truth["range_m"]),
            "pixels": sum(b["pixels"] for b in truth["bands"]),
        },
    ]
    for row in rows:
        near, far = row["range_m"]
        median = (
            "-" if row["median_relative_error"] is None else f"{row['median_relative_error']:.1%}"
        )
        within = f"{row['within_10_percent']:.0%}"
        lines.append(
            f"{f'{near:.0f} to {far:.0f}':<12} {row['pixels']:>8} {row['coverage']:>8.0%} {within:>12} {median:>13}"
        )
    return lines + [Moving(**m).words for m in truth.get("moving", [])]
