"""Study of restitution: impacts of two spheres, or of a sphere and a wall, by every damping law."""
