"""Figures of what softtwin is said to do, each by one command from the root of the checkout.

Whatever of this folder is imported first sets one thread for BLAS and OpenMP, unless the user says otherwise:
before anything imports numpy, so that seconds are of one core. `SHARED` holds real recordings of others.
"""

import os
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

ROOT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("SOFTTWIN_DATA", ROOT.parent / "shared" / "data"))
