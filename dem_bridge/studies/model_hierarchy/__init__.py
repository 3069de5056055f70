"""Model hierarchy: the effect of leaving out each model term and numerical choice, and the smallest adequate model."""
