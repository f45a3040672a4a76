"""The whole diagnosis, and what to record next, asked from a session."""
