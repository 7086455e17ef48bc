"""The program around `gi_core`: window, command line, pictures."""

import os

# OpenBLAS keeps one spinning thread per core once it is loaded. Products here have three numbers, and the cores trace
# photons. A value set by the user stays.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
