"""Measure a fixed set of recordings and compare the results with stored ones."""

import os

# One thread: sums in another order differ in the last digit. Set before numpy is imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
