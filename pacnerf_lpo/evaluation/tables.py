"""The results of a run as Markdown tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def markdown_table(results: Mapping[str, Any]) -> str:
    """The results as Markdown: image metrics by phase and view set, then parameters, then what is missing and why."""
    lines = ["| phase | views | PSNR [dB] | SSIM | LPIPS |", "|---|---|---|---|---|"]
    notes: list[str] = []
    for phase in results["phases"]:
        if "error" in phase:
            notes.append(f"{phase['label']}: {phase['error']}")
            continue
        for views in ("train", "test"):
            metrics, scope = phase["image_metrics"][views], ""
            if metrics is None:
                metrics, scope = phase["first_frame_metrics"][views], ", frame 0"
            if metrics is None:
                continue
            if isinstance(metrics["lpips"], str):
                notes.append(f"LPIPS: {metrics['lpips']}")
            lines.append(f"| {phase['label']} | {views}{scope} | {_metric_cells(metrics)} |")
    lines += ["", *_parameter_lines(results)]
    return "\n".join([*lines, *(["", *dict.fromkeys(notes)] if notes else [])])


def _metric_cells(metrics: Mapping[str, Any]) -> str:
    psnr = "inf" if metrics["psnr"] is None else f"{metrics['psnr']:.2f}"
    lpips = "n/a" if isinstance(metrics["lpips"], str) else f"{metrics['lpips']:.3f}"
    return f"{psnr} | {metrics['ssim']:.3f} | {lpips}"


def _parameter_lines(results: Mapping[str, Any]) -> list[str]:
    last, guess = results["phases"][-1], results["guess"]
    errors = last.get("truth_errors")
    lines = ["| parameter | guess | identified |", "|---|---|---|"]
    if errors is not None:
        lines = ["| parameter | guess | identified | true | error |", "|---|---|---|---|---|"]
    for name, found in last["parameters"].items():
        if name not in results["free"] and found["value"] == 0:
            continue
        unit = "" if found["unit"] == "1" else f" {found['unit']}"
        known = "" if name in results["free"] else " (known)"
        cells = [f"{name}{known}", f"{guess[name]['value']:.4g}{unit}", f"{found['value']:.4g}{unit}"]
        if errors is not None:
            error = errors.get(name)
            cells += [f"{error['true']:.4g}{unit}", describe_error(error)] if error else ["unknown", ""]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def describe_error(error: Mapping[str, Any]) -> str:
    """``0.031 in log10``, ``0.020`` or ``0.035 rad``."""
    suffix = {"log10": " in log10", "plain": "", "radians": " rad"}[error["measure"]]
    return f"{error['error']:.3f}{suffix}"
