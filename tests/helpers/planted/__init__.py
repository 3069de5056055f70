"""Plant faults in files as other people's codes write them; nothing here shares code with the judge of such files.

``chains`` holds the scenes (with their own formulas and scene files), ``motion`` the integrators, ``faults`` the list
of faults and the set of causes that are true for each, ``files`` the writers, and ``cases`` draws cases from seeds.
"""
