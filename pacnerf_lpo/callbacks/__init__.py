"""Callbacks that surround a phase: checkpoints and interruption, progress, one TensorBoard time line."""
