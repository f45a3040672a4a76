"""Which hypothesis explains a residual, in NumPy and SciPy alone: noise, evidence, calibration, decision, intervals."""
