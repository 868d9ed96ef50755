"""Tables of long sequences, of those that break codecs, and of those whose order is lost."""

from __future__ import annotations

from evaluation.tables.markdown import decibel, table
from lab.record import results


def drift_table() -> str:
    """Drift by scene and GoF size."""
    rows = []
    for name, scene in results("drift").items():
        for key in (k for k in scene if k != "intra"):
            figures = scene[key]
            rows.append(
                [
                    name,
                    key.removeprefix("gof"),
                    f"{figures['bytes'] / scene['intra']['bytes']:.2f}",
                    f"{figures['mean_difference']:+.2f}",
                    f"{figures['worst_difference']:+.2f}",
                    f"{figures['slope_per_100_frames']:+.3f}",
                ]
            )
    head = ["scene", "GoF", "bytes / all-intra", "mean, dB", "worst frame, dB", "slope, dB per 100 frames"]
    return table(head, rows)


def stress_table() -> str:
    """The stress list."""
    rows = []
    for name, case in results("stress").items():
        if "num_bytes" not in case:
            rows.append([name, case["outcome"], "", "", "", ""])
            continue
        rows.append(
            [
                name,
                case["outcome"],
                case["frame_types"],
                str(case["num_bytes"]),
                f"{case['ratio_to_all_intra']:.3f}",
                decibel(case["quality"]["psnr"]),
            ]
        )
    return table(["case", "outcome", "frames", "bytes", "bytes / all-intra", "PSNR, dB"], rows)


def _percentage(share: float | None, digits: int = 4) -> str:
    return "-" if share is None else f"{100 * share:.{digits}f} %"


def identity_table() -> str:
    """How well Gaussians are found again whose order is lost."""
    rows = []
    for name, scene in results("identity").items():
        for noise, figures in scene.items():
            if noise == "coded":
                continue
            rows.append(
                [
                    name,
                    noise,
                    str(figures["num_gaussians"]),
                    f"{figures['continued']} of {figures['pairs']}",
                    _percentage(figures["precision"]),
                    _percentage(figures["recall"]),
                    _percentage(figures["worst_recall"]),
                    _percentage(figures["nearest_position_recall"], 1),
                    f"{figures['match_s']:.2f}",
                ]
            )
    head = ["scene", "changes", "N", "pairs continued", "precision", "recall", "recall, worst pair"]
    return table([*head, "nearest position", "s per pair"], rows)


def lost_order_table() -> str:
    """What a lost order costs in bytes and time."""
    rows = []
    for name, scene in results("identity").items():
        if "coded" not in scene:
            continue
        figures = scene["coded"]
        without = figures["without_turnover"]
        rows.append(
            [
                name,
                str(figures["num_gaussians"]),
                "-" if without is None else str(without["bytes"]),
                str(figures["in_order"]["bytes"]),
                str(figures["told_bytes"]),
                str(figures["lost"]["bytes"]),
                f"{figures['ratio_to_in_order']:.4f}",
                f"{figures['ratio_to_told']:.4f}",
                f"{figures['lost']['encode_s_per_frame']:.2f}",
            ]
        )
    head = ["scene", "N", "no births and deaths", "in order", "identities told", "order lost"]
    return table([*head, "lost / in order", "lost / told", "encode, s per frame"], rows)
