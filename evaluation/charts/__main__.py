"""Draw all charts from `evaluation/results/*.json`: `python -m evaluation.charts`."""

from __future__ import annotations

from evaluation.charts import bytes_chart, drift, rate_distortion, speed
from evaluation.results_file import has_results, results


def main() -> None:
    """Draw what there are results for."""
    if has_results("bench"):
        scenes = results("bench")
        rate_distortion.per_scene(scenes)
        rate_distortion.averaged(scenes)
        speed.chart(scenes)
        bytes_chart.chart(scenes)
    if has_results("drift"):
        drift.chart(results("drift"))


if __name__ == "__main__":
    main()
