"""Draw all charts from `evaluation/results/*.json`: `python -m evaluation.charts`."""

from __future__ import annotations

from evaluation.charts import bytes_chart, drift, rate_distortion, speed
from evaluation.curves import kinds
from lab.record import has_results, results


def main() -> None:
    """Draw what there are results for."""
    if has_results("bench"):
        scenes = results("bench") | (results("captures") if has_results("captures") else {})
        rate_distortion.per_scene(scenes)
        bytes_chart.chart(scenes)
        for kind, members in kinds(scenes).items():
            suffix = "" if kind == "objects" else f"_{kind}"
            rate_distortion.averaged(members, suffix)
            speed.chart(members, suffix)
    if has_results("drift"):
        drift.chart(results("drift"))


if __name__ == "__main__":
    main()
