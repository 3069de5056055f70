"""Settings for a wanted accuracy: predicted, checked by runs, and said why."""
