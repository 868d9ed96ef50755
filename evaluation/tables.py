"""The tables of `docs/results.md`, from `evaluation/results/*.json`: `python -m evaluation.tables`.

Each stands between `<!-- NAME -->` and `<!-- end of NAME -->`; the text around them is written by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from evaluation import capture_tables, intra_tables, paper_tables, prior_tables
from evaluation.bd import bd_delta, rate_at
from evaluation.record import REPOSITORY
from evaluation.results_file import curves, has_results, kinds, measured, results

PAGE = REPOSITORY / "docs" / "results.md"
_OURS = "dfcgs (default)"
_SHORT = "dfcgs, GoF 10"
_STILL = "dfcgs, no motion"
_PRESETS = ("low", "medium", "high", "transparent")


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows]]
    return "\n".join(lines) + "\n"


def _scenes() -> dict[str, Any]:
    """Scenes of the comparison: objects, and captures where they were measured."""
    return results("bench") | (results("captures") if has_results("captures") else {})


def _by_kind(made: Callable[[dict[str, Any]], str]) -> str:
    """A table of the objects and, where there are captures, one of them below."""
    parts = [(kind, made(scenes)) for kind, scenes in kinds(_scenes()).items()]
    return "\n".join(part if kind == "objects" else f"On captures:\n\n{part}" for kind, part in parts)


def _decibel(psnr: float | None) -> str:
    return "equal images" if psnr is None else f"{psnr:.1f}"


def against(scene: dict[str, Any], label: str) -> str:
    """Our bytes against a curve's at equal PSNR: BD-rate, or for one point the difference at its PSNR (*)."""
    found = curves(scene["points"])
    ours, theirs = found.get(_OURS, []), found.get(label, [])
    if label not in found:
        return "-"
    if not theirs:
        return "lossless"
    if (delta := bd_delta(theirs, ours)) is not None:
        psnr = "" if delta.bd_psnr is None else f" / {delta.bd_psnr:+.1f} dB"
        return f"{delta.bd_rate:+.0f} %{psnr}"
    rates = [(rate, rate_at(ours, psnr)) for rate, psnr in theirs]
    ratios = [mine / rate for rate, mine in rates if mine is not None]
    if ratios:
        return f"{100 * (float(np.exp(np.mean(np.log(ratios)))) - 1):+.0f} % *"
    best, top = max(p for _, p in theirs), max(p for _, p in ours)
    return (
        f"no overlap ({best:.1f} dB against our {top:.1f})" if best > top else f"no overlap ({best:.1f} dB)"
    )


def _labels(scenes: dict[str, Any]) -> list[str]:
    labels: dict[str, None] = {}
    for scene in scenes.values():
        labels |= dict.fromkeys(curves(scene["points"]))
    return [label for label in labels if not label.startswith("dfcgs")]


def bd_table() -> str:
    """Every baseline on every scene."""
    scenes = _scenes()
    labels = _labels(scenes)
    rows = [[name, *(against(scene, label) for label in labels)] for name, scene in scenes.items()]
    return _table(["scene", *labels], rows)


def refusal_table() -> str:
    """Why a method has no figure on a scene."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for name, scene in _scenes().items():
        for row in scene["points"]:
            if "bytes" not in row:
                reason = row.get("skipped") or row.get("failed")
                scenes = reasons.setdefault((row["label"], reason), [])
                scenes += [name] if name not in scenes else []
    rows = [[label, reason, ", ".join(scenes)] for (label, reason), scenes in reasons.items()]
    return _table(["method", "reason", "scenes"], rows)


def _preset_cell(row: dict[str, Any] | None) -> str:
    if row is None:
        return "-"
    return f"{row['bytes_per_frame'] / 1000:.0f} kB, {_decibel(row['psnr'])} dB, {row['ssim']:.4f}"


def preset_table() -> str:
    """Bytes and quality of the presets on every scene."""
    rows = []
    for name, scene in _scenes().items():
        found = {r["preset"]: r for r in measured(scene["points"]) if r["preset"]}
        rows.append([name, *(_preset_cell(found.get(preset)) for preset in _PRESETS)])
    return _table(["scene", *(f"`{p}`" for p in _PRESETS)], rows)


def speed_table() -> str:
    """Median seconds per frame and 100 k Gaussians, and the largest memory, by method."""
    return _by_kind(_speeds)


def _speeds(scenes: dict[str, Any]) -> str:
    found: dict[str, list[list[float]]] = {}
    for scene in scenes.values():
        scale = 1e5 / scene["facts"]["num_gaussians"]
        for row in measured(scene["points"]):
            found.setdefault(row["label"], []).append(
                [
                    row["encode_s_per_frame"] * scale,
                    row["decode_s_per_frame"] * scale,
                    row["encode_peak_mib"],
                    row["decode_peak_mib"],
                ]
            )
    rows = []
    for label, values in found.items():
        times, peaks = np.median(values, axis=0)[:2], np.max(values, axis=0)[2:]
        rows.append([label, f"{times[0]:.2f}", f"{times[1]:.2f}", f"{peaks[0]:.0f}", f"{peaks[1]:.0f}"])
    return _table(["method", "encode, s", "decode, s", "encode, MiB", "decode, MiB"], rows)


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
    return _table(head, rows)


def allocation_table() -> str:
    """What the codec's proportions of steps cost above the best ones."""
    found = results("allocation")
    targets = list(next(iter(found.values()))["targets"])
    rows = [
        [name, scene["group"], *(f"{100 * scene['targets'][t]['excess']:.1f} %" for t in targets)]
        for name, scene in found.items()
    ]
    return _table(["scene", "group", *(f"{-float(t):.0f} dB" for t in targets)], rows)


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
                _decibel(case["quality"]["psnr"]),
            ]
        )
    return _table(["case", "outcome", "frames", "bytes", "bytes / all-intra", "PSNR, dB"], rows)


def _differences(scenes: dict[str, Any], label: str, ours: str) -> tuple[int, list[float]]:
    """Scenes that a baseline codes, and logarithms of our bytes relative to its at equal PSNR."""
    logs, scene_count = [], 0
    for scene in scenes.values():
        found = curves(scene["points"])
        if not found.get(label):
            continue
        scene_count += 1
        if (delta := bd_delta(found[label], found.get(ours, []))) is not None:
            logs.append(math.log1p(delta.bd_rate / 100))
            continue
        rates = [(rate, rate_at(found.get(ours, []), psnr)) for rate, psnr in found[label]]
        logs += [math.log(mine / rate) for rate, mine in rates if mine is not None]
    return scene_count, logs


def _percent(logarithm: float) -> str:
    return f"{100 * math.expm1(logarithm):+.0f} %"


def averages() -> str:
    """One line per baseline: mean difference over scenes, best and worst scene; of captures apart."""
    return _by_kind(_averages)


def _averages(scenes: dict[str, Any]) -> str:
    rows = []
    for label in _labels(scenes):
        if not any(curves(scene["points"]).get(label) for scene in scenes.values()):
            rows.append([label, str(len(scenes)), *["lossless"] * 4])
            continue
        scene_count, logs = _differences(scenes, label, _OURS)
        _, short_logs = _differences(scenes, label, _SHORT)
        if not logs:
            rows.append([label, str(scene_count), *["no overlap"] * 4])
            continue
        cells = [_percent(float(np.mean(logs))), _percent(min(logs)), _percent(max(logs))]
        cells.append(_percent(float(np.mean(short_logs))) if short_logs else "-")
        rows.append([label, str(scene_count), *cells])
    head = [
        "against",
        "scenes",
        "default, mean",
        "best scene",
        "worst scene",
        "`--gof-size 10`, mean",
    ]
    return _table(head, rows)


def _inter_curve(scene: dict[str, Any], method: str) -> list[tuple[float, float]]:
    """Bytes of P-frames and PSNR of one of our curves."""
    rows = [row for row in scene["points"] if row["method"] == method and "bytes_by_frame_type" in row]
    return [(float(row["bytes"] - row["bytes_by_frame_type"]["I"]), row["psnr"]) for row in rows]


def _mean_rate(rates: list[float]) -> str:
    """Geometric mean of BD-rates in percent."""
    return f"{100 * math.expm1(float(np.mean(np.log1p(np.array(rates) / 100)))):+.1f} %"


def _control_points(scene: dict[str, Any]) -> str:
    """Control points with symbols in the P-frames of `medium`: least, median, most."""
    for row in scene["points"]:
        if row["method"] == "dfcgs" and row["setting"] == "medium" and "control_points" in row:
            kinds = zip(row["control_points"], row["frame_types"], strict=True)
            found = [count for count, kind in kinds if kind == "P"]
            return f"{min(found)} / {int(np.median(found))} / {max(found)}" if found else "-"
    return "-"


def motion_table() -> str:
    """What motion saves: bytes at equal PSNR against the same without it."""
    parts = [(kind, *_motion_rows(scenes)) for kind, scenes in kinds(_scenes()).items()]
    many = sum(bool(files) for _, _, files, _ in parts) > 1
    rows = []
    for kind, found, files, inters in parts:
        rows += found
        if files:
            name = f"mean of {kind}" if many else "mean"
            rows.append([name, _mean_rate(files), "", _mean_rate(inters) if inters else "", ""])
    head = [
        "scene",
        "whole file, bytes at equal PSNR",
        "PSNR at equal bytes",
        "P-frames, bytes at equal PSNR",
    ]
    return _table([*head, "control points"], rows)


def _motion_rows(scenes: dict[str, Any]) -> tuple[list[list[str]], list[float], list[float]]:
    """Rows of scenes, and their BD-rates of files and of P-frames."""
    rows, files, inters = [], [], []
    for name, scene in scenes.items():
        found = curves(scene["points"])
        delta = bd_delta(found.get(_STILL, []), found.get(_OURS, []))
        if delta is None:
            continue
        inter = bd_delta(_inter_curve(scene, "dfcgs_still"), _inter_curve(scene, "dfcgs"))
        psnr = "" if delta.bd_psnr is None else f"{delta.bd_psnr:+.2f} dB"
        files.append(delta.bd_rate)
        if inter is not None:
            inters.append(inter.bd_rate)
        shown = "-" if inter is None else f"{inter.bd_rate:+.1f} %"
        rows.append([name, f"{delta.bd_rate:+.1f} %", psnr, shown, _control_points(scene)])
    return rows, files, inters


def _ablation_cell(inter: float | None, file: float | None) -> str:
    shown = ["-" if rate is None else f"{rate:+.1f}" for rate in (inter, file)]
    return "no overlap" if inter is None and file is None else f"{' / '.join(shown)} %"


def _mean_where_all(found: dict[str, Any], variant: str, key: str) -> str:
    """Mean of a variant over the scenes on which the default has a figure; none if it lacks one of them."""
    rates = [scene.get(variant, {}).get(key) for scene in found.values() if scene["default"][key] is not None]
    known = [rate for rate in rates if rate is not None]
    return _mean_rate(known).removesuffix(" %") if known and len(known) == len(rates) else "-"


def ablation_table() -> str:
    """Bytes of P-frames and of whole files at equal PSNR of every variant against the default."""
    found = results("motion")
    variants: dict[str, None] = {}
    for scene in found.values():
        variants |= dict.fromkeys(name for name in scene if name != "default")
    rows = []
    for variant in variants:
        scenes = [scene.get(variant, {}) for scene in found.values()]
        cells = [_ablation_cell(row.get("bd_rate_inter"), row.get("bd_rate_file")) for row in scenes]
        means = [_mean_where_all(found, variant, f"bd_rate_{part}") for part in ("inter", "file")]
        rows.append([variant, *cells, "-" if set(means) == {"-"} else f"{' / '.join(means)} %"])
    return _table(["variant", *found, "mean"], rows)


def long_smooth_table() -> str:
    """Our bytes as a part of quantised delta + zstd's on smooth scenes of 60 frames."""
    found = results("long_smooth")
    labels = list(dict.fromkeys(label for scene in found.values() for label in scene["ratios"]))
    rows = [
        [name, *(f"{scene['ratios'][label]:.2f}" if label in scene["ratios"] else "-" for label in labels)]
        for name, scene in found.items()
    ]
    return _table(["scene", *labels], rows)


def compensation_table() -> str:
    """Motion without residual: both rules, and the last frame repeated."""
    rows = []
    for name, scene in results("compensation").items():
        for qp, settings in scene.items():
            if not qp.startswith("qp"):
                continue
            for setting, row in settings.items():
                if setting == "against":
                    continue
                least = settings["against"].get(setting, {}).get("least_gain")
                rows.append(
                    [
                        f"{name}, QP {qp[2:]}",
                        setting.replace("_", " "),
                        "-" if "bytes_p" not in row else f"{row['bytes_p'] / 1000:.1f}",
                        f"{row['psnr']:.2f}",
                        "" if least is None else f"{least:+.1f}",
                    ]
                )
    head = ["scene", "rule", "P-frames, kB", "PSNR, dB"]
    return _table([*head, "main is better by, dB, worst frame"], rows)


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
    return _table([*head, "nearest position", "s per pair"], rows)


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
    return _table([*head, "lost / in order", "lost / told", "encode, s per frame"], rows)


TABLES: dict[str, tuple[str, Callable[[], str]]] = {
    "averages": ("bench", averages),
    "motion": ("bench", motion_table),
    "ablation": ("motion", ablation_table),
    "compensation": ("compensation", compensation_table),
    "long smooth": ("long_smooth", long_smooth_table),
    "bd": ("bench", bd_table),
    "refusals": ("bench", refusal_table),
    "presets": ("bench", preset_table),
    "speed": ("bench", speed_table),
    "drift": ("drift", drift_table),
    "stress": ("stress", stress_table),
    "allocation": ("allocation", allocation_table),
    "identity": ("identity", identity_table),
    "lost order": ("identity", lost_order_table),
    "intra": ("intra", intra_tables.ratio_table),
    "intra lossless": ("intra", intra_tables.lossless_table),
    "quantised input": ("quantised_input", intra_tables.quantised_table),
    "captures": ("captures", capture_tables.bytes_table),
    "captures truth": ("captures", capture_tables.truth_table),
    "promise": ("promise", capture_tables.promise_table),
    "surroundings": ("surroundings", intra_tables.surroundings_table),
    "prior": ("prior", prior_tables.streams_table),
    "prior models": ("prior", prior_tables.models_table),
    "paper curves": ("paper_profile", paper_tables.curves_table),
    "paper whole": ("paper_profile", paper_tables.whole_table),
    "paper ablations": ("paper_ablations", paper_tables.ablation_table),
}


def replace_between(text: str, name: str, body: str) -> str:
    """`text` with what stands between the marks of `name` replaced; raises ValueError without marks."""
    start, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    head, found, rest = text.partition(start)
    _, ended, tail = rest.partition(end)
    if not found or not ended:
        raise ValueError(f"{PAGE.name} has no marks for the table {name!r}")
    return f"{head}{start}{body}{end}{tail}"


def main() -> None:
    """Write all tables that there are results for."""
    text = PAGE.read_text()
    for name, (source, table) in TABLES.items():
        if has_results(source):
            text = replace_between(text, name, table())
    PAGE.write_text(text)


if __name__ == "__main__":
    main()
