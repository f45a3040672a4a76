"""The engine runs on two threads in its tests, so that the sum over slices of particles is tested too."""

import os

os.environ.setdefault("PACNERF_LPO_THREADS", "2")
