"""Settings identified from the current model."""
