"""What a scene requires: each piece of physics and each numerical choice left out, and the least model that does."""
