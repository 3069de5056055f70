"""Tests of the package. They and their processes use one thread for linear algebra.

Matrices are small here. Threads of OpenBLAS that wait for each other on busy cores take 30 times as long as one alone.
The variable is read when numpy is first imported.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
