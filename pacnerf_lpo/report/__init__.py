"""What a run found, to look at: pictures, films, particles, and one HTML page."""
