"""Judge files of any code: their errors against the reference, their order, and the likely cause of a difference."""
