"""Optimisers for a handful of parameters."""
