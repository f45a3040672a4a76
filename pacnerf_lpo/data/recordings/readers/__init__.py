"""One reader per layout: what it looks for, whether it finds it, and how it reads it."""
