"""``pacnerf-lpo evaluate``: image quality and parameter errors of a run."""

from pacnerf_lpo.evaluation.evaluate import evaluate_run
from pacnerf_lpo.evaluation.tables import markdown_table


def run(run_dir: str, truth: str | None = None) -> None:
    """Measure PSNR, SSIM and LPIPS on training and test views, and parameter errors where the truth is given.

    Prints Markdown tables and writes results.json into the run directory.

    example: pacnerf-lpo evaluate runs/demo --truth demo

    Args:
        run_dir: folder that fit wrote, or the scene with it.
        truth: a truth.json, or demo for the shipped scene; without it no truth is opened.
    """
    print(markdown_table(evaluate_run(run_dir, truth)))
