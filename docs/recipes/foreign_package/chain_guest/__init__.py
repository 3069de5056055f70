"""A backend, a study and a reader of files for dem_bridge."""
