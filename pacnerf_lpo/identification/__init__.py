"""What the phases and the diagnosis share: the comparison of a model with a video, and the search for its optimum."""
