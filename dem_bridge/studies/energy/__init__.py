"""Study of the energy error over many contacts, beside its prediction by backward error analysis."""
