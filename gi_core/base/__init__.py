"""Numbers, threads and compiled kernels: nothing here knows a scene."""
