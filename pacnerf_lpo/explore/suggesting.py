"""What would help a model as it stands."""
