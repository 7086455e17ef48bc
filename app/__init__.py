"""The program round `gi_core`: window, command line, pictures."""

import os

# numpy's library of matrix products keeps a thread a core spinning from the moment it is loaded; products here are of
# three numbers, and those cores trace photons. Whoever has set it knows better.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
