"""Recordings of any common layout, and their conversion into the layout that the package reads."""
