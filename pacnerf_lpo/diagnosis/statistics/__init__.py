"""Statistics of residual vectors: noise model from twins, score test, calibration, classes, intervals, acceptance."""
