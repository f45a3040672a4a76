"""Finding the missing physics: compare, localise, screen, refit, check."""
