"""How large a step may be: the largest that is stable and the largest that is accurate, beside what is predicted."""
