"""Recordings without cameras: positions of a body over time, made a scene of a known shape in flight."""
