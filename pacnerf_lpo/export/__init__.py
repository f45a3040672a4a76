"""A run for other programs: particles, trajectories, surfaces and films in the files that they read."""
