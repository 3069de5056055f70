"""Studies: many runs, one question. They put backends, observables, comparison and verdicts together."""
