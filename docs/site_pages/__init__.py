"""What makes pages, films and pictures of the documentation from the classes of the package."""
