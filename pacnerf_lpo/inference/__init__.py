"""Statistics of a comparison, in NumPy alone: what its entries are, and their error where the physics is right."""
